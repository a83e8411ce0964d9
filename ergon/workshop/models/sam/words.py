"""The words of Synth-A-Modeler: the values of each, and features that no score can express."""

from __future__ import annotations

import re
from collections.abc import Mapping

RATE = 44_100  # [Hz]: the library of the language fixes it

# Values in parentheses. A name follows them; in a link the masses that it joins follow the name.
MASSES: Mapping[str, tuple[str, ...]] = {
    "mass": ("m", "x0", "v0"),
    "ground": ("x0",),
    "port": (),
    "resonators": ("f", "T60", "m"),  # any number of times
}
LINKS: Mapping[str, tuple[str, ...]] = {"link": ("k", "R", "o"), "touch": ("k", "R", "o")}
OUTPUTS = ("audioout", "display")  # `word,name,expression;`
CODE = "faustcode"

_REFUSED_WORDS = {
    "a pluck remembers on which side it is, and no law of a score keeps a state yet": "pluck",
    "its pulse goes on by itself, and no law of a score keeps a state yet": """
        pulseTouch pulseTouchGeneral pulseTouchTable""",
    "waveguides are not built yet; write a STRING": """
        waveguide termination junction junctionlink junctionlinkUnderneath junctiontouch
        junctiontouchUnderneath junctionpluck junctionpluckUnderneath""",
    "the compiler takes this word, and the library of the language has no law for it": """
        linkCA BUT massCA detent stiffeninglink softeninglink pulsetouch""",
    "names of groups have gone from the language, so that it changes nothing; leave it out": """
        controladjust""",
}
REFUSED: Mapping[str, str] = {
    word: why for why, words in _REFUSED_WORDS.items() for word in words.split()
}
WORDS = (*MASSES, *LINKS, *OUTPUTS, CODE, *REFUSED)

_BEGINS = re.compile(
    rf"\s*(?:(?:{'|'.join(WORDS)})\s*\(|(?:{'|'.join(OUTPUTS)}|controladjust)\s*,|{CODE}\s*:)"
)


def is_model(text: str) -> bool:
    """Whether the first line that is not a comment is a statement of Synth-A-Modeler."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            return _BEGINS.match(line) is not None
    return False


def usage(model_word: str) -> str:
    """A statement as documentation shows it: `link(k, R, o), name, a, b;`."""
    if model_word in OUTPUTS:
        return f"{model_word}, name, expression;"
    values = ", ".join(MASSES.get(model_word) or LINKS.get(model_word, ()))
    ellipsis = ", ..." if model_word == "resonators" else ""
    return f"{model_word}({values}{ellipsis}), name{', a, b' if model_word in LINKS else ''};"
