"""Solutions of positions, with error bars and sensitivities."""
