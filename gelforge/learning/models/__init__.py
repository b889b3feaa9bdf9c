"""Trained models: their files, thresholds and intervals."""
