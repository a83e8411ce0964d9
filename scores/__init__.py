"""The score language: turns text into a checked piece, and reports every mistake with its place."""
