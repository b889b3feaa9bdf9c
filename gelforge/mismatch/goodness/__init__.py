"""Whether what a model leaves is noise."""
