"""The terminal's side of a session: keys, prompt, status line, or plain lines."""
