"""Constitutive models, and what is computed from them alone."""
