"""The contact of a body's surface with an indenter."""
