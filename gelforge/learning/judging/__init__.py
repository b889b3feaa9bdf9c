"""Predictions of held-out cells, and what they are worth."""
