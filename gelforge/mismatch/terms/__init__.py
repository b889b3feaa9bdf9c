"""What a model of the readings may consist of: effects, maps, a discrepancy; and their refits."""
