"""Material tests as laboratories write them, in one common form."""
