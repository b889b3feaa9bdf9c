"""The shapes of indenters."""
