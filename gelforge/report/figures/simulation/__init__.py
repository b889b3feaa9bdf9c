"""What was simulated: the sensor and its plan, deformed sections, force over depth, labels, and how far readings are off."""
