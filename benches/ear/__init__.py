"""How near instruments sound to recorded ones: figures of a sound, recorded figures, a verdict."""
