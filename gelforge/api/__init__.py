"""What `import gelforge as gf` offers, one file for each kind of thing."""
