"""Cells: one indentation position with all its depths."""
