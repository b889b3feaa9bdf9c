"""What other people's files hold."""
