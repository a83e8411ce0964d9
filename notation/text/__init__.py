"""Text with places: YAML as nodes, mistakes where they stand, spelling, spacing."""
