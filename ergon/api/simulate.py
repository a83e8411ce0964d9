"""A score played to its end without being heard: what its keys, masses and contacts do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.notation.text.errors import Diagnostic, quote

from . import score as scores
from .check import stage_as_checked

if TYPE_CHECKING:
    from ergon.rendering.bow_sticking import StickDetector
    from ergon.rendering.follow import GestureFidelity
    from ergon.rendering.mass_excursions import ContactClosings, Excursion
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.hands import StagedGesture
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Simulated:
    """How closely keys followed gestures, how far masses swung, and which contacts closed.

    Frames are at `rate` [Hz]; `left_out` counts the contacts and points that were not measured.
    `stage` is the stage that was played.
    """

    followed: list[GestureFidelity]
    swings: list[Excursion]
    contacts: list[ContactClosings]
    rate: float
    left_out: int
    bows: list[StickDetector]
    stage: Stage

    @property
    def gestures(self) -> list[StagedGesture]:
        """The gestures of keys."""
        return self.stage.gestures


def simulate(piece: Piece, task: str, report: Report | None = None) -> Simulated:
    """Play a piece to its end; `report` hears of its progress under the name of `task`."""
    from ergon.rendering.follow import gesture_fidelities
    from ergon.rendering.mass_excursions import measure_excursions
    from ergon.scores.staging.probes import probe_piece

    report = report or Report()
    probed_piece = probe_piece(piece)
    stage = stage_as_checked(probed_piece.piece, report)
    with report.progress(task, stage.n_analysed_frames, stage.rate) as progress:
        excursions, contact_closings, slidings = measure_excursions(
            stage, probed_piece, progress.update
        )
    fidelities = gesture_fidelities(stage)
    return Simulated(
        fidelities,
        excursions,
        contact_closings,
        stage.rate,
        probed_piece.n_left_out,
        slidings,
        stage,
    )


def never_stuck_warnings(simulated: Simulated) -> list[Diagnostic]:
    """W323 for each bow that slipped and did not stick again."""
    warnings = []
    stuck_names = {bow.friction_link.full_name for bow in simulated.bows if bow.has_stuck}
    for bow in simulated.bows:
        rubbing = bow.friction_link
        if rubbing.full_name in stuck_names or not bow.has_slipped:
            continue
        message = (
            f"bow {quote(rubbing.name)} never sticks: once it has slipped, the speed of "
            f"{rubbing.b.name} against {rubbing.a.name} does not stay between "
            f"{bow.low_speed:.3g} and {bow.high_speed:.3g} m/s for half a millisecond"
        )
        help = "press harder, bow more slowly, or rub where the string gives way more"
        warnings.append(Diagnostic("W323", message, rubbing.module.place, None, help))
    return warnings


def shared_name(full_name: str, families: Mapping[str, str]) -> str:
    """The name of a contact for all notes of its instrument; families: `Piece.note_families`."""
    part, _, name = full_name.rpartition(".")
    return f"{families.get(part, part)}.{name}"


def never_closed_warnings(piece: Piece, simulated: Simulated) -> list[Diagnostic]:
    """W320 for each contact that closed neither here nor at another note of its instrument.

    A contact over a range closes if one of its points does; else the nearest of them counts.
    """
    families = piece.note_families()
    closed_names = {
        shared_name(closing.contact.full_name, families)
        for closing in simulated.contacts
        if closing.n_closings
    }
    nearest_by_contact: dict[str, ContactClosings] = {}
    for closing in simulated.contacts:
        nearest_before = nearest_by_contact.get(closing.contact.full_name)
        if nearest_before is None or closing.depth_max > nearest_before.depth_max:
            nearest_by_contact[closing.contact.full_name] = closing
    warnings = []
    for closing in nearest_by_contact.values():
        if shared_name(closing.contact.full_name, families) in closed_names:
            continue
        contact = closing.contact
        position_text = scores.where(piece, closing.deepest_frame / simulated.rate)
        message = (
            f"contact {quote(contact.full_name)} never closes: {contact.a.name} comes within "
            f"{-1e3 * closing.depth_max:.3g} mm of touching {contact.b.name}, at {position_text}"
        )
        help = "make the gap smaller by more than that, or the movement larger"
        if closing.swapped_depth_max > 0.0:
            part = contact.full_name.rpartition(".")[0]
            end_names = (end.name.removeprefix(f"{part}.") for end in (contact.b, contact.a))
            help = (
                f"its ends may be swapped: as `between: [{', '.join(end_names)}]` it closes, "
                f"{1e3 * closing.swapped_depth_max:.3g} mm deep in this motion; or {help}"
            )
        warnings.append(Diagnostic("W320", message, contact.module.place, None, help))
    return warnings
