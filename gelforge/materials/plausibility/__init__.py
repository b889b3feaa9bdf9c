"""What is odd in a material test: said, corrected where that is asked for, or refused."""
