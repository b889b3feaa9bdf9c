"""How a solution follows changes of what it was made of."""
