"""The sensor and the indenter from their descriptions: shapes, meshes, sizes, symmetry."""
