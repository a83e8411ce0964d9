"""Struck objects: the modes of a recorded stroke, and the instrument made from them."""
