"""Training rows of simulated sensors, SYNTHETIC: presses that are solved once, moved, and drawn as images."""
