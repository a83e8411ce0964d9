"""What is typed: a line becomes commands, or a refusal with its place and a better line."""
