"""Effects: how each setting of `mechanics.effects` enters the model, one module per family, and their catalogue."""
