"""Rows, their scaling and symmetry, and what a network is."""
