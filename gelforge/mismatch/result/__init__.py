"""What a verdict is: its file and its tables."""
