"""Studies, and their files."""
