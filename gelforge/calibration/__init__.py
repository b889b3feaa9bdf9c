"""Parameters of a sensor from its own presses, by the problem and the fits of the verdict."""
