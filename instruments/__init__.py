"""The model language: turns the modules of an instrument into a network."""
