"""Generators of the pages of docs/: `make docs`."""
