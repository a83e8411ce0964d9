"""Directions, loudspeakers, and conversion from one array of loudspeakers to another."""
