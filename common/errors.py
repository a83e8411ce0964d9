"""The root of ergon's errors."""

from __future__ import annotations


class ErgonError(Exception):
    """What ergon refuses: its message is written for the user."""
