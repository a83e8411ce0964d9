"""What every room may use: errors, reports, text for terminals, files opened with care, T60."""
