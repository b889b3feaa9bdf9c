"""Recorded indentations and images to forces and flow features."""
