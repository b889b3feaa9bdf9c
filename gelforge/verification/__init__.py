"""Checks of the finite elements against independent reference solutions, shared by the tests and the report's table."""
