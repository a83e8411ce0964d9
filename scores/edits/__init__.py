"""Edits of a score's text, one for each verb that changes the music."""
