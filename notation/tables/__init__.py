"""One field table: it reads, checks, describes, and makes the editor's schema."""
