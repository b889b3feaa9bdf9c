"""The chapters of a verdict's page: answer, curves, maps and flow, read from the verdict's folder alone."""
