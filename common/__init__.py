"""What every room may use: text for terminals, files that are opened with care."""
