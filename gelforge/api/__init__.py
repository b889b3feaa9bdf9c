"""What `import gelforge as gf` offers, one file for each kind of thing.

A function checks what it is given, and makes one call. `gelforge.__init__` names each one and imports it when it is first
used, so nothing is exported here.
"""
