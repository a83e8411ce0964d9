"""`ergon new`: a folder with a score that plays, and what an editor needs to help with it."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

import click

from . import options
from .console import Console
from .outcome import Refused
from .schema import FILE as SCHEMA

_TEMPLATES_FOLDER = Path(str(files("ergon"))) / "cli" / "templates"
TEMPLATES = ("bell", "duet")
_TEMPLATE_TITLE = "title: A new piece"  # the title in the templates, which are complete scores
_FOLDER_NAME = re.compile(r"[^\W\d][\w-]*")


@click.command()
@click.argument("words", metavar="NAME", nargs=-1, required=True)
@click.option(
    "--template",
    type=click.Choice(TEMPLATES),
    default=TEMPLATES[0],
    help="Score to begin with: a key and a bell, or two keys that feel each other.",
)
@options.with_console
def new(console: Console, words: tuple[str, ...], template: str) -> None:
    """Make a folder with a score that plays.

    It holds score.yaml, an instrument of its own, a README and the schema with which an editor
    completes and explains names. Nothing that exists is overwritten.
    """
    from ergon.exchange.new_folder import new_folder

    if len(words) > 1:
        raise Refused(f"a name is one word; write ergon new {'-'.join(words)}")
    folder = Path(words[0])
    if not _FOLDER_NAME.fullmatch(folder.name):
        name_advice = (
            f"; write ergon new {folder.stem}" if _FOLDER_NAME.fullmatch(folder.stem) else ""
        )
        raise Refused(
            f"'{folder.name}' cannot name a piece; a name has letters, digits, - and _{name_advice}"
        )
    folder_files = contents(template, folder.name)
    with new_folder(folder) as new_path:
        for path, text in folder_files.items():
            (new_path / path).parent.mkdir(exist_ok=True)
            (new_path / path).write_bytes(text.encode())
    for path in folder_files:
        if console.json:
            console.record("wrote", file=str(folder / path))
        else:
            console.detail(f"wrote {folder / path}")
    console.say(f"{folder} is ready: cd {folder} && ergon render score.yaml")


def contents(template: str, piece_name: str) -> dict[str, str]:
    """The files of a new piece and their texts."""
    from .schema import schema_text

    template_folder = _TEMPLATES_FOLDER / template
    piece_title = piece_name.replace("-", " ").replace("_", " ").capitalize()
    text_by_path = {}
    for path in sorted(template_folder.rglob("*.yaml")):
        text = path.read_text(encoding="utf-8").replace(_TEMPLATE_TITLE, f"title: {piece_title}", 1)
        text_by_path[str(path.relative_to(template_folder))] = text
    text_by_path["README.md"] = _README.format(title=piece_title)
    text_by_path[SCHEMA] = schema_text()
    return text_by_path


_README = """\
# {title}

    ergon check score.yaml           names, units, times: every mistake with its place
    ergon render score.yaml          the sound, as score.wav
    ergon play score.yaml            the sound, through the loudspeakers
    ergon repl score.yaml            it keeps sounding while you type: try `play`, then `help`
    ergon render score.yaml --watch  again whenever you save
    ergon plot score.yaml knock      a gesture, asked and done

`score.yaml` is the piece; `instruments/` what it is played on. `score-1.schema.json` lets an editor
with the YAML language server complete names and explain them while you type.
"""
