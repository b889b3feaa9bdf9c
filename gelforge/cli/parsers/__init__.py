"""Arguments of each family of commands; standard library only."""
