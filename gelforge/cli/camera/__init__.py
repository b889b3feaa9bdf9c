"""Commands about cameras: the lens, the pose."""
