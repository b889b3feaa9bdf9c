"""A judgement in the form and words of a verdict."""
