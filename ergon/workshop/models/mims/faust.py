"""The MIMS script in a Faust program: a comment, beside the code that was made from it."""

from __future__ import annotations

import re

from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import FORMS

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_STATEMENT = re.compile(r"^[ \t]*@\w+[ \t]+(\w+)", re.MULTILINE)
_KEYWORDS = frozenset(keyword for forms in FORMS.values() for keyword in forms)


def find_script(program_text: str) -> str:
    """The lines of a program's script, with their line numbers kept. Raises ModelError if there is
    none.
    """
    script_matches = [match for match in _COMMENT.finditer(program_text) if _is_script(match[0])]
    if not script_matches:
        message = (
            "this Faust program has no MIMS script: a comment with lines such as @m mass 1 0 0"
        )
        raise ModelError(message)
    if len(script_matches) > 1:
        line = program_text.count("\n", 0, script_matches[1].start()) + 1
        raise ModelError("a second MIMS script begins here; leave one", line)
    (match,) = script_matches
    lines_before = "\n" * program_text.count("\n", 0, match.start())
    return lines_before + "\n".join(map(_line_text, match[0].split("\n")))


def _is_script(comment: str) -> bool:
    return any(statement_match[1] in _KEYWORDS for statement_match in _STATEMENT.finditer(comment))


def _line_text(line: str) -> str:
    """A line of a script; headings and comment delimiters become empty."""
    line = line.replace("/*", "").replace("*/", "").strip()
    return line if line.startswith(("@", "~")) else ""
