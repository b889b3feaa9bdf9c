"""Positions, and the poses that an indenter visits there."""
