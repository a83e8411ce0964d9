"""How a number with a unit is written, wherever one is."""

# Possessive quantifiers (*+): a hostile line is read once, never by backtracking.
NUMBER = r"(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
UNIT = r"[^\W\d_]*+"
MAX_TIME = 1e9  # beats or seconds, thirty years: keeps every sum finite
