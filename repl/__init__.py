"""The prompt: a session in which the music is typed while it sounds."""
