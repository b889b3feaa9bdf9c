"""Force labels between solved sites: solved nodal forces are moved with the indenter, weighted, and binned afterwards."""
