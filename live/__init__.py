"""A staged piece on hardware: loudspeakers, keys, hands."""
