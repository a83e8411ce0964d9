"""Lists of messages to pmpd and pmpd~ of Pure Data: read, and written as a score."""
