"""A language server: what an editor asks while a score is written."""
