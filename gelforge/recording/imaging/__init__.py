"""Images and the flow between them."""
