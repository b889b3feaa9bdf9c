"""Commands about a study as a whole: begin one, check it, look at its labels, release its lock."""
