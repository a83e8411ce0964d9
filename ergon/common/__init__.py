"""Helpers of all packages: errors, reports, text for terminals, careful reading of files, T60."""
