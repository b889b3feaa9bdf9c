"""Shards of features and force labels."""
