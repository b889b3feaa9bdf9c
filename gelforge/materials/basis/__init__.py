"""What every analysis of a material test takes: its common form, its stresses and segments, and the effects it measures."""
