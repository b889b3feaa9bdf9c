"""What was read: sessions, their noise, outliers, and the readings in the order taken."""
