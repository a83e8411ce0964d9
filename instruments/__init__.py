"""The model language: modules of an instrument become a network."""
