"""Commands that the workflow's rules call: read, one call, write.

Each takes the study's file and writes one product; `workflow_commands` has their arguments.
"""
