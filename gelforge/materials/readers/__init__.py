"""Material tests as laboratories write them, in the common form."""
