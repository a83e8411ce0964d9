"""The terminal side of a session: keys, prompt and status line, or plain lines."""
