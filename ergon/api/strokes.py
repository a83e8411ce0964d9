"""Contacts that close at their first stroke, and not at later ones that are as strong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

from ergon.notation.text.errors import Diagnostic, quote

from . import score as scores
from .simulate import shared_name

if TYPE_CHECKING:
    from ergon.instruments.model import Module, Target
    from ergon.rendering.mass_excursions import ContactClosings
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.hands import StagedGesture

    from .simulate import Simulated

_ROUNDING_TOLERANCE = 1e-9  # [m], and as a ratio of strokes: smaller differences are rounding
_KindByModule = Mapping[tuple[str, str], str]  # kinds of modules, by part and name
_THROWN_KINDS = ("MAS", "CEL")  # modules that a stroke throws at a contact


class _StrokeReach(NamedTuple):
    """A stroke: when it begins [s]; how far it takes a key towards a contact [m], or its impulse
    [N·s].
    """

    begin_instant: float
    reach: float


class _ContactPlayer(NamedTuple):
    """What may close a contact: the words for one of its strokes and for several, and the
    strokes.
    """

    singular: str
    plural: str
    strokes: Iterable[_StrokeReach]


def closed_once_warnings(piece: Piece, simulated: Simulated) -> list[Diagnostic]:
    """W334 for each contact that does not close again, though later strokes go as far or are as
    strong.

    Strokes act on an end of the contact, or on a key that throws such an end. A contact that
    closes again at another note of its instrument is left out, and so is one that is closed at
    the end.
    """
    families = piece.note_families()
    kinds = {(part, module.name): module.kind for part, module in piece.modules()}
    warnings: dict[str, list[Diagnostic | None]] = {}
    for full_name, contact_points in groupby(
        simulated.contacts, lambda contact_point: contact_point.contact.full_name
    ):
        point_list = list(contact_points)
        if any(contact_point.first_frame is not None for contact_point in point_list):
            contact_diagnostic = _contact_warning(piece, simulated, point_list, kinds)
            warnings.setdefault(shared_name(full_name, families), []).append(contact_diagnostic)
    return [
        contact_diagnostics[0]
        for contact_diagnostics in warnings.values()
        if contact_diagnostics[0] is not None and None not in contact_diagnostics
    ]


def _contact_warning(
    piece: Piece, simulated: Simulated, contact_points: list[ContactClosings], kinds: _KindByModule
) -> Diagnostic | None:
    """The warning for a contact that closed, of one point or of several; None if there is none."""
    contact = contact_points[0].contact
    first_closed = min(
        point.first_frame for point in contact_points if point.first_frame is not None
    )
    last_closed = max(point.last_frame for point in contact_points if point.last_frame is not None)
    if any(point.is_closed for point in contact_points):
        return None
    for player in _contact_players(piece, simulated, contact.module, kinds):
        strokes = sorted(player.strokes)
        # No stroke closed a contact that is closed from the beginning.
        earlier_strokes = [
            stroke
            for stroke in strokes
            if stroke.begin_instant <= (first_closed or last_closed) / simulated.rate
        ]
        later_strokes = [
            stroke
            for stroke in strokes[len(earlier_strokes) :]
            if stroke.begin_instant > last_closed / simulated.rate
        ]
        if (first_closed and not earlier_strokes) or len(earlier_strokes) + len(
            later_strokes
        ) < len(strokes):
            continue  # something else closed it, or several strokes did
        reach_min = earlier_strokes[-1].reach * (1 - _ROUNDING_TOLERANCE) if first_closed else 0.0
        n_as_far = sum(stroke.reach >= reach_min and stroke.reach > 0.0 for stroke in later_strokes)
        if n_as_far:
            contact_time = scores.where(piece, first_closed / simulated.rate)
            message = f"contact {quote(contact.full_name)} closes at {contact_time} only, "
            message += (
                f"though {n_as_far} later {player.plural if n_as_far > 1 else player.singular}"
            )
            help_text = (
                "`ergon check --simulate` lists how far masses swing; the mass that is struck "
            )
            help_text += "may not have returned"
            return Diagnostic("W334", message, contact.module.place, None, help_text)
    return None


def _contact_players(
    piece: Piece, simulated: Simulated, contact: Module, module_kinds: _KindByModule
) -> Iterator[_ContactPlayer]:
    """Keys that close a contact, and strikes on one of its ends."""
    for key, direction in _closing_keys(piece, contact, module_kinds):
        strokes = (
            gesture_stroke
            for staged_gesture in simulated.gestures
            if staged_gesture.key == key
            for gesture_stroke in _gesture_strokes(staged_gesture, direction)
        )
        yield _ContactPlayer(f"stroke of {key} goes as far", f"strokes of {key} go as far", strokes)
    timeline, mats = simulated.stage.timeline, simulated.stage.built_network.assembly.mats
    if timeline is None:
        return
    for contact_end in contact.ends:
        if module_kinds[contact_end.part, contact_end.module] not in _THROWN_KINDS:
            continue
        module_name, direction = (
            f"{contact_end.part}.{contact_end.module}",
            _closing_direction(contact, contact_end),
        )
        instants_and_impulses = timeline.strikes_on(mats[contact_end.part, contact_end.module])
        strokes = (
            _StrokeReach(instant, direction * impulse) for instant, impulse in instants_and_impulses
        )
        yield _ContactPlayer(
            f"strike on {module_name} is as strong",
            f"strikes on {module_name} are as strong",
            strokes,
        )


def _closing_keys(
    piece: Piece, contact: Module, kinds: _KindByModule
) -> Iterator[tuple[str, float]]:
    """Keys that close a contact, directly or by a mass that they push, and the direction they move
    in to do so: 1 or -1.
    """
    struck_keys = {(name, key.struck): name for name, key in piece.keys.items()}
    for end in contact.ends:
        if key := struck_keys.get((end.part, end.module)):
            yield key, _closing_direction(contact, end)
    thrown_ends = {
        (other_end.part, other_end.module) for other_end in contact.ends
    } - struck_keys.keys()
    for _, piece_module in piece.modules():
        if piece_module.kind != "BUT" or piece_module is contact:
            continue
        targets_by_module = {(end.part, end.module): end for end in piece_module.ends}
        joined_ends = thrown_ends & targets_by_module.keys()
        if any(kinds[end] in _THROWN_KINDS for end in joined_ends):
            yield from (
                (struck_keys[struck_key], _closing_direction(piece_module, other_end))
                for struck_key, other_end in targets_by_module.items()
                if struck_key in struck_keys
            )


def _closing_direction(contact: Module, end: Target) -> float:
    """The direction in which an end of a contact moves to close it: upwards 1, downwards -1."""
    upwards = contact.fields["side"] == "below"
    return 1.0 if upwards == (end == contact.ends[0]) else -1.0


def _gesture_strokes(gesture: StagedGesture, direction: float) -> Iterator[_StrokeReach]:
    """The strokes of a written gesture in a direction, each from one turn to the turn back."""
    if gesture.is_layer:
        return  # a layer adds to an unknown path
    begin_instant, lowest, highest = gesture.start, float("inf"), -float("inf")
    for instant, position in zip(gesture.instants, gesture.positions, strict=True):
        reach_forward = direction * position
        if reach_forward < highest - _ROUNDING_TOLERANCE:
            if highest > lowest + _ROUNDING_TOLERANCE:
                yield _StrokeReach(begin_instant, highest)
            begin_instant, lowest, highest = instant, reach_forward, reach_forward
            continue
        if (
            reach_forward <= lowest + _ROUNDING_TOLERANCE
            and highest <= lowest + _ROUNDING_TOLERANCE
        ):
            begin_instant, lowest = instant, min(lowest, reach_forward)
        highest = max(highest, reach_forward)
    if highest > lowest + _ROUNDING_TOLERANCE:
        yield _StrokeReach(begin_instant, highest)
