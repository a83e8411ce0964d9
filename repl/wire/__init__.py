"""A session in a process of its own, and prompts that come and go."""
