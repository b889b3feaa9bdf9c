"""Checks of the analysis against the generator's solutions: these import both, so nothing of the generator imports them."""
