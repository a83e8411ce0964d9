"""The text of a composer, read and checked in memory."""

import textwrap

from ergon.scores.reading.load import Loaded, load


def check(text: str, **overlay: str) -> Loaded:
    """Check a text with the files that it uses, given by stem."""
    files = {f"{name}.yaml": textwrap.dedent(body) for name, body in overlay.items()}
    return load("s.yaml", text=textwrap.dedent(text), overlay=files)


def check_reports(text: str, **overlay: str) -> list[tuple[str, int, str]]:
    """Code, line and message of every report."""
    return [(d.code, d.place.line, d.message) for d in check(text, **overlay).diagnostics]


def codes(text: str, **overlay: str) -> list[str]:
    """The codes alone."""
    return [code for code, *_ in check_reports(text, **overlay)]
