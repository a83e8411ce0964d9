"""Helpers of all packages: errors, reports, text for terminals, careful opening of files and reading
of JSON and TOML, T60.
"""
