"""Recorded presses and images to forces and flow features."""
