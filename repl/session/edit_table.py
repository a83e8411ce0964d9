"""The table of edits: for each command, the function that makes the new version from the old one.

A module of edits adds its functions by decorators; `version_edits` imports all such modules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from ergon.repl.language.commands import Command
from ergon.repl.session.version import Faders, NotTakenError, Version, piece_of
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit

_EditMaker = TypeVar("_EditMaker", bound=Callable[..., "VersionEdit"])
_TextsEdit = TypeVar("_TextsEdit", bound=Callable[..., Texts])
_FadersEdit = TypeVar("_FadersEdit", bound=Callable[..., Faders])

VERSION_EDITS: dict[type[Command], Callable[[Any], VersionEdit]] = {}


def makes_edit(command_type: type[Command]) -> Callable[[_EditMaker], _EditMaker]:
    """Decorate a function that makes the edit of a command."""

    def register(make_edit: _EditMaker) -> _EditMaker:
        VERSION_EDITS[command_type] = make_edit
        return make_edit

    return register


def edits_texts(command_type: type[Command]) -> Callable[[_TextsEdit], _TextsEdit]:
    """Decorate a function that gives the new texts from command, version and beat."""

    def register(edit_texts: _TextsEdit) -> _TextsEdit:
        def make_edit(command: Command) -> VersionEdit:
            return lambda version, beat: with_texts(version, edit_texts(command, version, beat))

        VERSION_EDITS[command_type] = make_edit
        return edit_texts

    return register


def edits_faders(command_type: type[Command]) -> Callable[[_FadersEdit], _FadersEdit]:
    """Decorate a function that gives the new faders from command, faders and names of
    instruments.
    """

    def register(edit_faders: _FadersEdit) -> _FadersEdit:
        def make_edit(command: Any) -> VersionEdit:
            return lambda version, beat: replace(
                version,
                faders=edit_faders(command, version.faders, instruments_of(version, command.name)),
            )

        VERSION_EDITS[command_type] = make_edit
        return edit_faders

    return register


def with_texts(version: Version, texts: Texts) -> Version:
    """The version with other texts, and their piece. Raises NotTakenError."""
    return replace(version, texts=texts, piece=piece_of(texts))


def instruments_of(version: Version, instrument_name: str | None) -> frozenset[str]:
    """The named instrument or its notes, or the instruments that a player's key is linked to.

    Raises NotTakenError.
    """
    piece = version.piece
    if instrument_name is None:
        return frozenset()
    if instrument_name in piece.instruments:
        return frozenset([instrument_name])
    if instrument_name in piece.families:
        return frozenset(piece.families[instrument_name])
    player = piece.players.get(instrument_name)
    if player is None:  # a line that was typed later and acts earlier has renamed or removed it
        raise NotTakenError(f"{instrument_name} was renamed or removed by another line")
    player_key = player.key
    linked_parts = frozenset(
        end.part
        for instrument in piece.instruments.values()
        for module in instrument.modules
        for end in _other_ends(module.fields.get("between"), player_key)
    )
    if not linked_parts:
        raise NotTakenError(
            f"key {player_key} of {instrument_name} is linked to no instrument; name the "
            "instrument to change instead"
        )
    return linked_parts


def _other_ends(linked_ends: Any, key_name: str) -> list[Any]:
    """The ends of a link other than the key; none if the link does not touch the key."""
    if not linked_ends or all(end.part != key_name for end in linked_ends):
        return []
    return [end for end in linked_ends if end.part != key_name]
