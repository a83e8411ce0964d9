"""`ergon explain`: a mistake, by the code that its message shows."""

from __future__ import annotations

import click

from ergon.common.terminal import clean
from ergon.notation.text.spelling import nearest

from . import manual
from .outcome import Refused


@click.command()
@click.argument("code")
def explain(code: str) -> None:
    """Explain a mistake by the code that its message shows, such as E204.

    The page says what is wrong, how it comes about, and how to put it right, with an example.
    """
    pages = manual.pages()
    page = pages.get(code.upper())
    if page is None or not page.is_mistake:
        codes = [page.name for page in pages.values() if page.is_mistake]
        suggestion = nearest(code.upper(), codes) if len(code) == len("E204") else None
        suggestion = suggestion or _titled(code, pages)
        hint = (
            f"did you mean {suggestion}?" if suggestion else "`ergon help errors` lists all codes"
        )
        raise Refused(f"{clean(code)} is not the code of a mistake; {hint}")
    manual.show(page.text)


def _titled(words: str, pages: dict[str, manual.Page]) -> str | None:
    """The code and the title of the mistake whose page has words in its title; None without one."""
    phrase = words.casefold().strip()
    titles = [page.headings[0] for page in pages.values() if page.is_mistake]
    return next((title for title in titles if phrase and phrase in title.casefold()), None)
