"""What `ergon check --simulate` says about a score that is computed unheard."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING

from ergon.api import score
from ergon.api.simulate import never_closed_warnings, never_stuck_warnings, simulate
from ergon.api.strokes import closed_once_warnings

from .console import Console, plural
from .units import metres_text

if TYPE_CHECKING:
    from ergon.rendering.follow import GestureFidelity
    from ergon.rendering.mass_excursions import ContactClosings, Excursion
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece


def simulated(console: Console, path: str, loaded: Loaded, piece: Piece) -> None:
    """Compute a score to its end, and say what keys, masses and contacts did."""
    simulation = simulate(piece, f"simulating {path}", console)
    _print_followed(console, piece, simulation.followed)
    _print_swings(console, simulation.swings)
    _print_contacts(console, piece, simulation.rate, simulation.contacts)
    if simulation.left_out:
        console.say(f"{plural(simulation.left_out, 'more point and contact')} not measured")
    contact_warnings = [
        *never_closed_warnings(piece, simulation),
        *closed_once_warnings(piece, simulation),
        *never_stuck_warnings(simulation),
    ]
    score.show(console, loaded, contact_warnings)


def _print_swings(console: Console, excursions: Sequence[Excursion]) -> None:
    for excursion in excursions:
        if excursion.point.is_fixed:
            continue
        if console.json:
            console.record(
                "swing", mass=excursion.point.name, low_m=excursion.low, high_m=excursion.high
            )
        elif excursion.high > excursion.low:
            low, high = metres_text(excursion.low), metres_text(excursion.high)
            console.data(f"{excursion.point.name}: from {low} to {high}\n")
        else:
            console.data(f"{excursion.point.name}: does not move\n")


def _print_contacts(
    console: Console, piece: Piece, rate: float, all_closings: Sequence[ContactClosings]
) -> None:
    for closings in all_closings:
        contact_names = f"{closings.contact.a.name} on {closings.contact.b.name}"
        if console.json:
            console.record(
                "contact",
                name=closings.contact.name,
                striker=closings.contact.a.name,
                struck=closings.contact.b.name,
                closed=closings.n_closings,
                first_s=None if closings.first_frame is None else closings.first_frame / rate,
                deepest_m=closings.depth_max,
            )
        elif closings.first_frame is not None:
            first_contact = score.where(piece, closings.first_frame / rate)
            console.data(
                f"{closings.contact.name} ({contact_names}): closed "
                f"{plural(closings.n_closings, 'time')}, first "
                "at "
                f"{first_contact}, {metres_text(closings.depth_max)} deep at most\n"
            )


def _print_followed(console: Console, piece: Piece, fidelities: Sequence[GestureFidelity]) -> None:
    for fidelity in fidelities:
        instant_text = None if isnan(fidelity.worst_at) else score.where(piece, fidelity.worst_at)
        if console.json:
            console.record(
                "followed",
                player=fidelity.player,
                gesture=fidelity.name,
                key=fidelity.key,
                times=fidelity.times,
                is_layer=fidelity.is_layer,
                ergons=fidelity.n_ergons,
                rms_m=fidelity.rms,
                worst_m=fidelity.worst,
                worst_at_s=fidelity.worst_at,
                worst_at=instant_text,
                pushed_by=fidelity.pushed_by,
                strongest_m_s=fidelity.strongest,
                missed=fidelity.missed,
                first_points_missed=fidelity.first_points_missed,
            )
            continue
        times = f" ×{fidelity.times}" if fidelity.times > 1 else ""
        gesture_words = f"{fidelity.player} {fidelity.name}{times} on {fidelity.key}: "
        if fidelity.is_layer:
            gesture_words += "a layer, added to the gesture that runs"
        elif fidelity.n_ergons == 0:
            gesture_words += "ended by the next gesture before its first ergon"
        elif instant_text is None:
            gesture_words += "followed exactly"
        else:
            gesture_words += (
                f"followed within {metres_text(fidelity.rms)} rms, worst "
                f"{metres_text(fidelity.worst)} at {instant_text}"
            )
            gesture_words += f", pushed by {fidelity.pushed_by}" if fidelity.pushed_by else ""
        if fidelity.missed:
            gesture_words += f"; {plural(fidelity.missed, 'step')} needed more than the force limit"
        if fidelity.first_points_missed:
            gesture_words += f"; first point missed {plural(fidelity.first_points_missed, 'time')}"
        console.data(gesture_words + "\n")
        console.detail(
            f"  {plural(fidelity.n_ergons, 'ergon')}, the strongest {fidelity.strongest:.3g} m/s; "
            f"free key from {metres_text(fidelity.low)} to {metres_text(fidelity.high)}"
        )
