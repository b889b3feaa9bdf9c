"""Training, and adapting to another sensor."""
