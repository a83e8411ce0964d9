"""Musical time: bars, beats, tempo, and the seconds that they are."""
