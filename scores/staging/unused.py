"""Finds instruments without an audible output, and audible instruments that nothing moves."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.instruments import following, proxies
from ergon.instruments.model import Target
from ergon.instruments.module_kinds import LINK_KINDS, POINT_KINDS
from ergon.notation.text.errors import Diagnostic, quote
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.listening import audible_outputs, targets_of


class _PartGroups:
    """Groups of keys and instruments that links connect."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}

    def representative(self, part_name: str) -> str:
        """The part that represents a group."""
        while part_name in self._parents:
            part_name = self._parents[part_name]
        return part_name

    def join(self, first_part: str, second_part: str) -> None:
        """Put two parts in one group."""
        first_part, second_part = self.representative(first_part), self.representative(second_part)
        if first_part != second_part:
            self._parents[first_part] = second_part


def warn_unused(piece: Piece) -> list[Diagnostic]:
    """Report W321 if an instrument reaches no output that is heard, W322 if nothing moves it.

    W321 is reported only if the piece has some output that is heard, W322 only if it has parts or
    strikes.
    """
    part_groups = _PartGroups()
    links_by_part = {}
    for part_name, part_module in piece.modules():
        for link_target in following.targets(part_module):
            part_groups.join(part_name, link_target.part)
        if part_module.kind in LINK_KINDS:
            end_parts = tuple(end.part for end in part_module.ends)
            links_by_part[part_name, part_module.name] = end_parts
            part_groups.join(*end_parts)
        elif part_module.kind == "PROXY":
            for link_target in proxies.targets(part_module.fields):
                part_groups.join(part_name, link_target.part)
        elif part_module.kind == "SURFACE":
            part_groups.join(part_name, part_module.fields["of"].part)
    for coupling in piece.duet:
        part_groups.join(coupling.a.part, coupling.b.part)
    family_names = piece.note_families()
    for members in piece.families.values():  # one instrument: not all notes need be played
        for member in members[1:]:
            part_groups.join(member, members[0])
    listened_groups = {
        part_groups.representative(part) for part in _listened_parts(piece, links_by_part)
    }
    moved_groups = {part_groups.representative(part) for part in _moved_parts(piece)}
    is_played = bool(piece.parts or piece.strikes)
    warnings = []
    for instrument in piece.instruments.values():
        if not any(module.kind in POINT_KINDS for module in instrument.modules):
            continue
        instrument_name = quote(family_names.get(instrument.name, instrument.name))
        part_group = part_groups.representative(instrument.name)
        if listened_groups and part_group not in listened_groups:
            message = (
                f"{instrument_name} cannot be heard: no output of it, or of what it is linked to, "
                "is routed"
            )
            help_text = "add a route to the mix, or an output (`out: {SOX: …}`)"
            warnings.append(Diagnostic("W321", message, instrument.place, None, help_text))
        elif is_played and part_group in listened_groups and part_group not in moved_groups:
            message = (
                f"nothing moves {instrument_name}: no key that is played and no strike reaches it"
            )
            help_text = "link it to a key that a player plays, strike it, or give it X0 or V0"
            warnings.append(Diagnostic("W322", message, instrument.place, None, help_text))
    return list(dict.fromkeys(warnings))


def _listened_parts(
    piece: Piece, links_by_part: dict[tuple[str, str], tuple[str, ...]]
) -> Iterator[str]:
    """Parts whose movement or force is heard."""
    for _, instrument, output in audible_outputs(piece):
        for target in targets_of(instrument, output):
            yield from links_by_part.get((target.part, target.module), (target.part,))


def _moved_parts(piece: Piece) -> Iterator[str]:
    """Parts that are moved by a hand, a strike, a drive or an initial state."""
    for play in piece.parts:
        yield piece.players[play.player].key
    for player in piece.players.values():
        if player.hand == "live":
            yield player.key
    for strikes in piece.strikes:
        yield from (target.part for target in strikes.to)
    for part_name, part_module in piece.modules():
        moved_target = part_module.fields.get("to")
        if part_module.kind in ("ENX", "ENF") and isinstance(moved_target, Target):
            yield moved_target.part
        if part_module.fields.get("X0") or part_module.fields.get("V0"):
            yield part_name  # in space: X0 is always written; springs and gravity move it
