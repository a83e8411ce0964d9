"""Models of other mass-interaction programs: their languages are read and written as a score."""
