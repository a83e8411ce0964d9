"""Scores that ship with ergon: every command that reads a score takes their names too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

PACK = ".ergonpack"  # as in ergon.exchange.pack, which is imported when a pack is opened


def bundled_scores() -> dict[str, Path]:
    """The scores in scores/library, by name."""
    from importlib.resources import files

    library = Path(str(files("ergon"))) / "scores" / "library"
    # A file in a subfolder is part of a score, not a score itself.
    return {path.stem: path for path in sorted(library.glob("*.yaml"))}


def is_pack(path: str) -> bool:
    """Whether a file is a pack, by its name."""
    return path.lower().endswith(PACK)


class PackedPath(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """The path of a file. A pack stands for its score, which is unpacked while the command runs,
    but where the command `opens` packs itself.
    """

    name = "score"

    def __init__(self, *, opens: bool = True) -> None:
        """`opens` says whether a pack is opened here."""
        self.opens = opens

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The path as text: the command checks it when it opens it. Raises PackError, OSError."""
        path_text = str(value)
        if not (self.opens and is_pack(path_text)) or ctx is None or ctx.resilient_parsing:
            return path_text
        from ergon.api.packs import opened_pack

        return str(ctx.with_resource(opened_pack(path_text)))


class ScorePath(PackedPath):
    """The path of a score or a pack, or the name of a score that ships, such as `duet`; a file of
    that name comes first.
    """

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The path as text: the command checks it when it opens it. Raises PackError, OSError."""
        path_text = super().convert(value, param, ctx)
        if not path_text.replace("-", "").isalnum() or Path(path_text).exists():
            return path_text
        from ergon.notation.text.spelling import nearest

        bundled_paths = bundled_scores()
        if path_text not in bundled_paths and path_text == "help" and ctx is not None:
            self.fail(f"the help is shown by: {ctx.command_path} --help", param, ctx)
        if path_text not in bundled_paths and (suggestion := nearest(path_text, bundled_paths)):
            self.fail(
                f"there is no file {path_text}; did you mean {suggestion}, which ships?", param, ctx
            )
        return str(bundled_paths.get(path_text, path_text))
