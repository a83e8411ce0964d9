"""Characters of typeset text, which come with copied lines and look like those of a score."""

from __future__ import annotations

import re

_SPACE = "write a plain space, and none between a number and its unit"
_DASH = "write '..' for a range, and '-' for a minus"
# For each character: its name, and what to write instead.
_CHARACTERS = {
    "\u00a0": ("a no-break space", _SPACE),
    "\u2007": ("a figure space", _SPACE),
    "\u2009": ("a thin space", _SPACE),
    "\u202f": ("a narrow no-break space", _SPACE),
    "\u200b": ("a space without width", "remove it"),
    "\ufeff": ("a byte order mark", "remove it"),
    "\u2013": ("an en dash", _DASH),
    "\u2014": ("an em dash", _DASH),
    "\u2026": ("an ellipsis", "write two points: '..'"),
    "\u2212": ("a typeset minus sign", "write '-'"),
    "\u00d7": ("a multiplication sign", "write 'x'"),
    "\u201c": ("a typeset quotation mark", "write '\"'"),
    "\u201d": ("a typeset quotation mark", "write '\"'"),
}
BLANK = re.compile("[\u00a0\u2007\u2009\u202f\u200b]")
_ANY = re.compile(f"[{''.join(_CHARACTERS)}]")
_BEFORE_UNIT = re.compile(r"(?<=\d)[\u00a0\u2007\u2009\u202f](?=[A-Za-zµμ%°])")
_RANGE_DASH = re.compile(r"(?<=\w)\s*[\u2013\u2014]\s*(?=[\w.+-])")
# The first number of a range, and the unit of the second.
_WITHOUT_UNIT = re.compile(
    r"(?<![\w.])(\d+(?:\.\d+)?)(?=\.\.-?\d+(?:\.\d+)?([A-Za-zµμ%°][\w/²³]*))"
)
_PLAIN_CHARACTERS = {
    **dict.fromkeys("\u00a0\u2007\u2009\u202f", " "),
    **dict.fromkeys("\u2013\u2014\u2212", "-"),
    **dict.fromkeys("\u201c\u201d", '"'),
    "\u200b": "",
    "\ufeff": "",
    "\u2026": "..",
    "\u00d7": "x",
}


def typeset_character(typed_word: str) -> str | None:
    """The first typeset character of a word, and what to write instead: `an en dash (U+2013); write
    …`; None if it has none.
    """
    typeset_match = _ANY.search(typed_word)
    if typeset_match is None:
        return None
    name, advice = _CHARACTERS[typeset_match[0]]
    return f"{name} (U+{ord(typeset_match[0]):04X}); {advice}"


def plain(typeset_word: str) -> str:
    """A word in the characters of a score: `2g` for `2 g`, `C3..C5` for `C3–C5`, `2g..3g` for
    `2–3g`.
    """
    typeset_word = _RANGE_DASH.sub("..", _BEFORE_UNIT.sub("", typeset_word))
    return _WITHOUT_UNIT.sub(
        r"\1\2", _ANY.sub(lambda match: _PLAIN_CHARACTERS[match[0]], typeset_word)
    )
