"""Equilibrium along a path of the indenter."""
