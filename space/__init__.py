"""Directions, loudspeakers, and the ways from one array of loudspeakers to another."""
