"""The score language: text becomes a checked piece, with every mistake in its place."""
