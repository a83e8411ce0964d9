"""Models of miPhysics (XML): read, and written as a score."""
