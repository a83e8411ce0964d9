"""Some of the instruments of a score, as their routes are heard."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

from . import score as scores
from .errors import OptionError

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.outputs import Route
    from ergon.scores.reading.piece import Piece


def choose_routes(loaded: Loaded, only: str | None, except_: str | None) -> Loaded:
    """The score with the routes of some instruments alone, or without those of some.

    `only` and `except_` are names of instruments, with commas between them; all notes of an
    instrument are meant by its name. Everything moves as in the piece. Raises OptionError.
    """
    if only is None and except_ is None:
        return loaded
    if only is not None and except_ is not None:
        raise OptionError("only", "; leave one of the two out", excludes="except_")
    option_name, names_text = ("only", only) if only is not None else ("except_", except_ or "")
    piece = scores.piece_of(loaded)
    if not piece.mix.routes:
        raise OptionError(
            option_name, "the score has no routes; write them in `mix`, or use --stems"
        )
    chosen_names = [name.strip() for name in names_text.split(",")]
    _check_names(piece, option_name, chosen_names)
    routes = tuple(
        route
        for route in piece.mix.routes
        if _is_route_of(piece, route, chosen_names) == (option_name == "only")
    )
    if not routes:
        raise OptionError(option_name, "no instrument is left that is heard", value=names_text)
    return replace(loaded, piece=replace(piece, mix=replace(piece.mix, routes=routes)))


def _is_route_of(piece: Piece, route: Route, names: Collection[str]) -> bool:
    families = piece.note_families()
    return route.part in names or families.get(str(route.part), "") in names


def _check_names(piece: Piece, option: str, chosen_names: Collection[str]) -> None:
    from ergon.notation.text.spelling import nearest

    part_names = [*piece.instruments, *piece.families]
    for part_name in chosen_names:
        if part_name not in part_names:
            suggestion = nearest(part_name, part_names)
            advice = (
                f"; did you mean {suggestion}?"
                if suggestion
                else f"; the instruments: {', '.join(part_names)}"
            )
            raise OptionError(option, f"no instrument is called so{advice}", value=part_name)
