"""The finite elements behind a verdict."""
