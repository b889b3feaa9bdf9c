"""Whole studies: their keys, their files, and a study as a variant or a session changes it."""
