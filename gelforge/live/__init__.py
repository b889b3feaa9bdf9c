"""Forces of a camera as they come: capture, computation, server and page, recording."""
