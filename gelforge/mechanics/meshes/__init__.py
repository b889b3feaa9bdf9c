"""Elements, and meshes of them."""
