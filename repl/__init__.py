"""Live coding: lines become versions of a score, and versions take over while they sound."""
