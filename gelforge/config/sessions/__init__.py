"""Sessions of recordings, measured and virtual, and training sets from simulated sensors."""
