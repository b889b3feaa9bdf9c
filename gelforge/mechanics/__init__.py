"""The finite-element model: laws, meshes, contact, equilibrium."""
