"""Text with places: YAML as nodes, mistakes with their places, spelling suggestions, spacing."""
