"""The fields of a `tuning:`, of a score or of one of its instruments."""

from __future__ import annotations

from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import Text
from ergon.notation.tables.tuning import MAX_EDO
from ergon.notation.text.errors import TextError, quote


def _root(text: str) -> str:
    root_word = text.strip()
    if tuning.is_pitch(root_word) and not any(sign in root_word for sign in ("to", "of")):
        return root_word
    if tuning.spelled(root_word).endswith("Hz"):
        return tuning.hertz_word(q.quantity(root_word, q.FREQUENCY))
    message = f"{quote(root_word)} is neither a note such as C4 nor a frequency such as 264Hz"
    raise TextError(message, length=max(1, len(root_word)), code="E201")


TUNING = Record(
    "tuning",
    "which frequencies notes have",
    (
        Field("A4", k.HERTZ, "of equal steps, and of a scale without `keys`", shown="440Hz"),
        Field("edo", k.integer(1, MAX_EDO, "31"), "equal steps to an octave", shown="12"),
        Field("scale", k.PATH, "a scale of the program Scala, a .scl file"),
        Field("keys", k.PATH, "a keyboard map of Scala, a .kbm file; needs `scale`"),
        Field(
            "root",
            Text(_root, "a note or a frequency, such as C4 or 264Hz", is_value=True),
            "what ratios (3/2) and steps (18\\31) count from",
            shown="C4",
        ),
    ),
    value_pattern_by_field={
        "edo": r"(\d{1,4})(?: *(?:edo|EDO|tet|TET))?",
        "A4": r"(\d+(?:\.\d+)? *Hz)",
        "scale": r"(.+\.scl)",
    },
    synonyms={
        "a4": "A4",
        "reference": "A4",
        "scl": "scale",
        "kbm": "keys",
        "map": "keys",
        "equal": "edo",
        "divisions": "edo",
    },
)
