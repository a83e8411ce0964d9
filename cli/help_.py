"""`ergon help`: the help of a command, or a page of the manual; `ergon explain`: a mistake."""

from __future__ import annotations

import re
import sys

import click

from ergon.common.terminal import clean
from ergon.notation.text.spelling import nearest

from . import manual
from .outcome import Refused

_CODE = re.compile(r"[EWN]\d{3}")
_SHOWN = 12  # pages with a word, of many


@click.command("help")
@click.argument("words", metavar="[COMMAND|TOPIC]...", nargs=-1)
@click.pass_context
def help_command(ctx: click.Context, words: tuple[str, ...]) -> None:
    """Show the help of a command, or a page of the manual.

    TOPIC is the name of a page (`ergon help rhythm`), the code of a mistake (`ergon help E204`),
    or a word of a heading. Without one, all commands and pages are listed.
    """
    root = ctx.find_root()
    if not " ".join(words).strip():
        click.echo(root.get_help())
        click.echo(f"\nPages (ergon help PAGE):\n{_listed(manual.pages())}")
        return
    command = _command(root, words)
    if command is not None:
        click.echo(command.get_help())
        return
    known = manual.pages()
    topic = " ".join(words)
    page = known.get(topic) or known.get(topic.upper()) or known.get(f"howto/{topic}")
    if page is not None:
        _show(page)
        return
    matches = manual.with_heading(topic, known)
    if len(matches) == 1:
        _show(matches[0][0])
    elif matches:
        rows = "\n".join(f"  ergon help {page.name:24} {head}" for page, head in matches[:_SHOWN])
        click.echo(f"Pages about {clean(topic)}:\n{rows}")
    else:
        raise Refused(_unknown(topic, known, root))


@click.command()
@click.argument("code")
def explain(code: str) -> None:
    """Explain a mistake by the code that its message shows, such as E204.

    The page says what is wrong, how it comes about, and how to put it right, with an example.
    """
    known = manual.pages()
    page = known.get(code.upper())
    if page is None or not _CODE.fullmatch(page.name):
        codes = [name for name in known if _CODE.fullmatch(name)]
        near = nearest(code.upper(), codes) if len(code) == len("E204") else None
        asked = f"did you mean {near}?" if near else "`ergon help errors` lists all codes"
        raise Refused(f"{clean(code)} is not the code of a mistake; {asked}")
    _show(page)


def _command(root: click.Context, words: tuple[str, ...]) -> click.Context | None:
    """The context of a command that words name (`take trim`); None if they do not."""
    context, command = root, root.command
    for word in words:
        if not isinstance(command, click.Group):
            return None
        subcommand = command.get_command(context, word)
        if subcommand is None:
            return None
        command = subcommand
        context = click.Context(command, parent=context, info_name=word)
    return context


def _show(page: manual.Page) -> None:
    text = clean(page.text)
    if sys.stdout.isatty():
        click.echo_via_pager(text)
    else:
        click.echo(text, nl=False)


def _listed(known: dict[str, manual.Page]) -> str:
    names = [name for name in known if not _CODE.fullmatch(name) and "/" not in name]
    return click.wrap_text(", ".join(names), 78, "  ", "  ")


def _unknown(topic: str, known: dict[str, manual.Page], root: click.Context) -> str:
    command = root.command
    commands = command.list_commands(root) if isinstance(command, click.Group) else []
    near = nearest(topic, (*commands, *known))
    asked = f"did you mean '{near}'?" if near else "`ergon help` lists commands and pages"
    return f"no command and no page is called '{clean(topic)}'; {asked}"
