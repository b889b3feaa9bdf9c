"""The verdict on a material's own tests."""
