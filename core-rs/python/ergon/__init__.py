"""Ergon: write the gesture, hear the matter."""
