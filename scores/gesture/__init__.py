"""What a hand does: notation, transformations, the words of a part, captured takes."""
