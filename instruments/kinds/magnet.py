"""MAGNET: two poles that attract, or repel, the more the nearer they are."""

from __future__ import annotations

from ergon.instruments.kinds.written_laws import law_kind
from ergon.notation.tables import value_kinds

# The force of two poles falls with the square of their distance d + g (Coulomb 1785). It would be
# infinite where they meet, so within a tenth of g it is that at a tenth: a hundred times that of
# d = 0.
_POLE_LAW = "k/max(d + g, 0.1*g)**2"

MAGNET = law_kind(
    "MAGNET",
    "an attraction that falls with the square of a distance",
    {
        "k": (
            lambda quantities: value_kinds.NUMBER if quantities.is_ca else value_kinds.POLES,
            "force times the square of the distance; below 0 they repel",
        ),
        "g": (
            lambda quantities: value_kinds.POSITIVE if quantities.is_ca else value_kinds.SIZE,
            "how far apart the poles are where the two MATs are at one place",
        ),
    },
    law=_POLE_LAW,
)
