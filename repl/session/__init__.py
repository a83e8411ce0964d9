"""A session: versions of a score, when they take over, and what is kept of them."""
