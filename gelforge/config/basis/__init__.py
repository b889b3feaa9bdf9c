"""What every section shares, and YAML as text."""
