"""From the nodes of a score to a checked piece."""
