"""Forces of a camera as they come: capture, computation, server and page, recording.

`run.run_live` puts them together. The server needs the extra `live`, so nothing is exported here.
"""
