"""What a line of a part says: which gestures, in which order and rhythm, how often and how."""
