"""The chapters of a study's report."""
