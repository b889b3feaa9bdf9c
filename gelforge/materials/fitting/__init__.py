"""Constitutive models fitted to material tests, with what is not known of their parameters."""
