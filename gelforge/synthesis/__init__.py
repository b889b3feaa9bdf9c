"""Training rows of simulated sensors, SYNTHETIC: presses that are solved once, moved, and drawn as images."""

SESSION = "simulated"  # of the rows, in place of a recorded session's name
