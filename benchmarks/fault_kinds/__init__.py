"""Faults by kind: each module has `run(asked)`, which prints its table and returns the exit status."""
