"""Untrusted text without control characters, for a terminal and in JSON."""

from __future__ import annotations

import json
import re
from typing import Any

from .shown_paths import shown, shown_in_json

# Characters that steer a terminal, turn the direction of writing, take no room, or have no UTF-8:
# C0 but for tab and line ends, DEL, C1, bidi controls, zero-width space and its kind, line and
# paragraph separators, surrogates, tags. The joiners U+200C and U+200D are letters of some scripts.
_STEERING = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f"
    "\ufeff\ud800-\udfff\U000e0000-\U000e007f]|\r(?!\n)"
)


def clean(text: str) -> str:
    """The text with a `?` for each character that steers a terminal or cannot be encoded."""
    return _STEERING.sub("?", shown(text))


def printable(printed_text: str) -> str:
    """The text as one line: `?` replaces each character that is not printable."""
    if printed_text.isprintable():  # the fast path: every name of a score is passed
        return printed_text
    return "".join(c if c.isprintable() else "?" for c in printed_text)


def json_text(value: Any) -> str:
    """One line of JSON with control characters escaped."""
    text = shown_in_json(json.dumps(value, ensure_ascii=False))
    return _STEERING.sub(lambda control_match: json.dumps(control_match[0])[1:-1], text)
