"""The page of `ergon view` as a film: drawn frame by frame by a browser without a window."""
