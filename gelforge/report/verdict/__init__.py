"""The chapters of a verdict's page."""
