"""Files of solved positions, and what goes into them."""
