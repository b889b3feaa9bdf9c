"""The plan of a study, and what is checked before anything is solved."""
