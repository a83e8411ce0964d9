"""`ergon schema`: the JSON Schema of scores, for editors."""

from __future__ import annotations

import click

from . import options
from .console import Console

FILE = "score-1.schema.json"  # one for every major version of the format


@click.command()
@options.target("The file to write. Default: stdout.")
@options.force
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def schema(output: str | None, force: bool, quiet: bool) -> None:
    """Print the JSON Schema of scores, for editors.

    A first line `# yaml-language-server: $schema=./score-1.schema.json` in a score lets an editor
    complete and explain names; `ergon new` writes both.
    """
    from ergon.exchange.safe import write_text

    write_text(output or "-", schema_text(), force=force)
    if output not in (None, "-"):
        Console(quiet=quiet).say(f"wrote {output}")


def schema_text() -> str:
    """The schema as indented JSON, with the mark that identifies files of ergon."""
    import json

    from ergon.scores.reading.schema import schema as build

    schema_fields = {"$comment": "made by ergon schema", **build()}
    return json.dumps(schema_fields, indent=1, ensure_ascii=False) + "\n"
