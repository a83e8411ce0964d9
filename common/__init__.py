"""Helpers of all packages: errors, reports, text for terminals, careful opening of files, T60."""
