"""Tetrahedral meshes of bodies bounded by closed surfaces."""
