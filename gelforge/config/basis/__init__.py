"""What all sections are made from: variants, and YAML as text; `gelforge.section` has names and ranges."""
