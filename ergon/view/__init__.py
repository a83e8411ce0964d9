"""Pictures: curves in the terminal and as SVG."""
