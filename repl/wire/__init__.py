"""A session in a process of its own, to which prompts connect."""
