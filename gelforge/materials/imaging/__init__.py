"""Stretches and shapes from pictures of specimens."""
