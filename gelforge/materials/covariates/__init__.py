"""What else changed in a test: time, rate, history, temperature."""
