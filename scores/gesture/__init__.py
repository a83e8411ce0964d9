"""What a hand does: notation, transformations, captured takes."""
