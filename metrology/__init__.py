"""What a real key is made of, found from the forces that it was given and where it went."""
