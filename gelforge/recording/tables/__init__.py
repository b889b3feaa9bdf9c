"""The tables of a session: errors that a recording raises, checks and joins."""
