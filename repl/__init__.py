"""The REPL: a score that is changed while it sounds."""
