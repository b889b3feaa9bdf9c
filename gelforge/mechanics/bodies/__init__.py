"""Bodies of elements: internal forces, tangents, and what their material remembers."""
