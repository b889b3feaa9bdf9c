"""Checks of the finite elements against solutions from outside: the tests and the report's table run the same functions."""
