"""Models of MIMS (v1) and mi-gen (v2): their language read, and written as a score."""
