"""Predictions of held-out sites, and what they are worth."""
