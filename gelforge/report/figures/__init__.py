"""One figure a module; no page knows how it is drawn."""
