"""Synthetic recordings of a sensor whose true physics is known."""
