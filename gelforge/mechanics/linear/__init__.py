"""The sparsity of the tangent, and the solvers of its linear systems."""
