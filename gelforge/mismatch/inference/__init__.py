"""How probable sets of effects are, by what they would change of the readings."""
