"""What a model of the readings may consist of: effects, maps, something unknown; and their refits."""
