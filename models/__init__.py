"""Models of other mass-interaction programs: their language read, and written as a score."""
