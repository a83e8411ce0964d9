"""What `ergon check --simulate` says about a score that is computed unheard."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING

from ergon.api import score
from ergon.api.simulate import never_closed_warnings, never_stuck_warnings, simulate
from ergon.api.strokes import closed_once_warnings

from .console import Console, plural
from .units import metres

if TYPE_CHECKING:
    from ergon.rendering.follow import GestureFidelity
    from ergon.rendering.mass_excursions import ContactClosings, Excursion
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece


def simulated(console: Console, path: str, loaded: Loaded, piece: Piece) -> None:
    """Compute a score to its end, and say what keys, masses and contacts did."""
    done = simulate(piece, f"simulating {path}", console)
    _keys(console, piece, done.followed)
    _swings(console, done.swings)
    _contacts(console, piece, done.rate, done.contacts)
    if done.left_out:
        console.say(f"{plural(done.left_out, 'more point and contact')} not measured")
    found = [
        *never_closed_warnings(piece, done),
        *closed_once_warnings(piece, done),
        *never_stuck_warnings(done),
    ]
    score.show(console, loaded, found)


def _swings(console: Console, moved: Sequence[Excursion]) -> None:
    for one in moved:
        if one.point.is_fixed:
            continue
        if console.json:
            console.record("swing", mass=one.point.name, low_m=one.low, high_m=one.high)
        elif one.high > one.low:
            low, high = metres(one.low), metres(one.high)
            console.data(f"{one.point.name}: from {low} to {high}\n")
        else:
            console.data(f"{one.point.name}: does not move\n")


def _contacts(
    console: Console, piece: Piece, rate: float, closed: Sequence[ContactClosings]
) -> None:
    for one in closed:
        names = f"{one.contact.a.name} on {one.contact.b.name}"
        if console.json:
            console.record(
                "contact",
                name=one.contact.name,
                striker=one.contact.a.name,
                struck=one.contact.b.name,
                closed=one.times,
                first_s=None if one.first is None else one.first / rate,
                deepest_m=one.deepest,
            )
        elif one.first is not None:
            first = score.where(piece, one.first / rate)
            console.data(
                f"{one.contact.name} ({names}): closed {plural(one.times, 'time')}, first at "
                f"{first}, {metres(one.deepest)} deep at most\n"
            )


def _keys(console: Console, piece: Piece, fidelities: Sequence[GestureFidelity]) -> None:
    for one in fidelities:
        at = None if isnan(one.worst_at) else score.where(piece, one.worst_at)
        if console.json:
            console.record(
                "followed",
                player=one.player,
                gesture=one.name,
                key=one.key,
                times=one.times,
                is_layer=one.is_layer,
                ergons=one.n_ergons,
                rms_m=one.rms,
                worst_m=one.worst,
                worst_at_s=one.worst_at,
                worst_at=at,
                pushed_by=one.pushed_by,
                strongest_m_s=one.strongest,
                missed=one.missed,
                first_points_missed=one.first_points_missed,
            )
            continue
        times = f" ×{one.times}" if one.times > 1 else ""
        words = f"{one.player} {one.name}{times} on {one.key}: "
        if one.is_layer:
            words += "a layer, added to the gesture that runs"
        elif one.n_ergons == 0:
            words += "ended by the next gesture before its first ergon"
        elif at is None:
            words += "followed exactly"
        else:
            words += f"followed within {metres(one.rms)} rms, worst {metres(one.worst)} at {at}"
            words += f", pushed by {one.pushed_by}" if one.pushed_by else ""
        if one.missed:
            words += f"; {plural(one.missed, 'step')} needed more than the force limit"
        if one.first_points_missed:
            words += f"; first point missed {plural(one.first_points_missed, 'time')}"
        console.data(words + "\n")
        console.detail(
            f"  {plural(one.n_ergons, 'ergon')}, the strongest {one.strongest:.3g} m/s; "
            f"free key from {metres(one.low)} to {metres(one.high)}"
        )
