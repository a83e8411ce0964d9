"""Scores that ship with ergon: every command that reads a score takes their names too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


def bundled() -> dict[str, Path]:
    """The scores in scores/library, by name."""
    from importlib.resources import files

    library = Path(str(files("ergon"))) / "scores" / "library"
    # A file in a subfolder is part of a score, not a score itself.
    return {path.stem: path for path in sorted(library.glob("*.yaml"))}


class ScorePath(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """The path of a score, or the name of one that ships, such as `duet`; a file of that name comes
    first.
    """

    name = "score"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The path as text: the command checks it when it opens it."""
        text = str(value)
        if not text.replace("-", "").isalnum() or Path(text).exists():
            return text
        from ergon.notation.text.spelling import nearest

        names = bundled()
        if text not in names and text == "help" and ctx is not None:
            self.fail(f"the help is shown by: {ctx.command_path} --help", param, ctx)
        if text not in names and (near := nearest(text, names)):
            self.fail(f"there is no file {text}; did you mean {near}, which ships?", param, ctx)
        return str(names.get(text, text))
