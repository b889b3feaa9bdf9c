"""One figure a module, by stage; no page knows how it is drawn."""
