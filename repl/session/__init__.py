"""A session: versions of a score, each an edit of its text, and when they take effect."""
