"""What an effect is, and what it may look at."""
