"""Builds, from a checked piece, the network and the timeline that play it."""
