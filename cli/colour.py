"""Colours and links of messages, and whether a terminal wants them."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import TextIO

from ergon.common.manual_pages import mistake_page_uri

_STYLES = {"error": "1;31", "warning": "1;33", "note": "1;36", "strong": "1", "dim": "2"}


def may_colour(stream: TextIO, environment: Mapping[str, str] | None = None) -> bool:
    """Whether to write colours: NO_COLOR (non-empty) decides first, then FORCE_COLOR, then whether
    the stream is a terminal that is not dumb.
    """
    env = os.environ if environment is None else environment
    if env.get("NO_COLOR"):
        return False
    if env.get("FORCE_COLOR"):
        return env["FORCE_COLOR"] != "0"
    return stream.isatty() and env.get("TERM") != "dumb"


def style(name: str, text: str) -> str:
    """Text for stderr in the colour of its meaning, if colours may be written."""
    return f"\x1b[{_STYLES[name]}m{text}\x1b[0m" if may_colour(sys.stderr) else text


def linked_code(linked_text: str, code: str) -> str:
    """Text for stderr that a terminal links with the page on a mistake (escape sequence OSC 8)."""
    # Colours may be forced into a file or the log of a server, which show a link as rubbish.
    uri = mistake_page_uri(code) if may_colour(sys.stderr) and sys.stderr.isatty() else None
    return f"\x1b]8;;{uri}\x1b\\{linked_text}\x1b]8;;\x1b\\" if uri else linked_text
