"""Commands that the workflow's rules call: read, one call, write."""
