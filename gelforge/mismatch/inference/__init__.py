"""Whether something is missing and where, how probable sets of effects are, and whether what an answer leaves is noise."""
