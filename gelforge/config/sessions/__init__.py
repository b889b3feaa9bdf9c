"""Sessions of recordings, measured and virtual."""
