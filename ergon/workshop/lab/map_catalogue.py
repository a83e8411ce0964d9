"""The maps that exist: those of the laboratory's own scenes, and those of a score."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import inf

import numpy as np

from ergon.scores.reading.piece import Piece
from ergon.workshop.lab import canonical, slow_key_scene
from ergon.workshop.lab.canonical import RATE
from ergon.workshop.lab.map_point import MapPoint, SteppedPoint
from ergon.workshop.lab.maps import Map
from ergon.workshop.lab.names import PLAN, SLOW, MapMetric
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import BareNetwork, Scene, Score
from ergon.workshop.lab.stiffness import has_contacts, stiffer
from ergon.workshop.lab.truth import EXACT_DB, UNKNOWN, Motion, Truth, converged, motion

_OVERSAMPLINGS = (1.0, 2.0, 4.0, 8.0)
_OVERSAMPLING_LABEL = "oversampling"


def _geometric_range(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(float(x) for x in np.geomspace(low, high, count))


def _converged_truth(scene: Scene) -> Callable[[int], Truth]:
    return lambda n_frames: converged(scene, n_frames)


def maps(
    method_name: str,
    piece: Piece | None,
    duration: float,
    error_db_max: float | None,
    metric: MapMetric = "waveform",
) -> dict[str, Map]:
    """The maps of a method, or of a piece; an error up to `error_db_max` [dB] counts as right."""
    if piece is not None:
        maps_by_name = maps_of_score(piece, duration, method_name)
        maps_by_name = {
            name: replace(survey_map, metric=metric) for name, survey_map in maps_by_name.items()
        }
    elif metric == "energy":
        maps_by_name = {"rattle": _rattle(method_name)}
    else:
        maps_by_name = built_in(method_name)
    if error_db_max is not None:
        maps_by_name = {
            name: replace(survey_map, error_limits=((inf, error_db_max),))
            for name, survey_map in maps_by_name.items()
        }
    return maps_by_name


def built_in(method_name: str) -> dict[str, Map]:
    """The maps of a method, by name."""
    if method_name == SLOW:
        maps = tuple(_slow_key_map(name, *survey_map) for name, survey_map in _SLOW_KEYS.items())
    else:
        makers = (_cell, _contact, _strike, _rate, _coupling)
        maps = tuple(make(method_name) for make in makers)
    return {survey_map.name: survey_map for survey_map in maps}


def _cell(method_name: str) -> Map:
    def case(kappa: float, zeta: float) -> MapPoint:
        def exact(n_frames: int) -> Truth:
            return Truth(canonical.exact_cell_motion(kappa, zeta, n_frames), EXACT_DB)

        return SteppedPoint(canonical.cell(kappa, zeta, method_name), Setting(method_name), exact)

    def load(kappa: float, zeta: float) -> float:
        return canonical.cell_load(kappa, zeta, method_name)

    # Offset from round numbers, so that no spot lies exactly on the border.
    top = 1.25 * min(canonical.eigenvalue_limit(method_name), 16.0)
    xs = tuple(float(x) for x in (np.arange(25) + 0.5) * top / 25)
    ys = tuple(float(y) for y in (np.arange(13) + 0.25) * 2.5 / 13)
    return Map("cell", "a mass on a spring and a damper", "κ = K/M", "ζ = Z/M", xs, ys, 0.1, case,
               load, log_x=False, log_y=False)  # fmt: skip


def _cases_over_oversampling(
    method: str, make: Callable[[float], BareNetwork], refinement: int = 16
) -> Callable[[float, float], MapPoint]:
    """Cases of a scene over oversampling. The true motion does not depend on the oversampling, so
    it is cached.
    """

    @cache
    def truth(kappa_or_speed: float, n_frames: int) -> Truth:
        return converged(make(kappa_or_speed), n_frames, refinement)

    def case(kappa_or_speed: float, oversampling: float) -> MapPoint:
        setting = Setting(method, round(oversampling))
        return SteppedPoint(
            make(kappa_or_speed), setting, lambda n_frames: truth(kappa_or_speed, n_frames)
        )

    return case


def _setting(method: str) -> Setting:
    return Setting(None if method == PLAN else method)


def _rattle(method: str) -> Map:
    def case(f: float, ratio: float) -> MapPoint:
        def no_truth(n_frames: int) -> Truth:
            return Truth(None, inf)

        return SteppedPoint(
            canonical.rattle(f, ratio), _setting(method), no_truth, canonical.energy_rise
        )

    return Map("rattle", "an undamped mass on a spring, which meets a stop", "its pitch [Hz]",
               "K of the stop over K of the spring", _geometric_range(100.0, 6000.0, 13),
               _geometric_range(0.1, 100.0, 7), 2.0, case, metric="energy")  # fmt: skip


def _contact(method_name: str) -> Map:
    def load(kappa: float, oversampling: float) -> float:
        return canonical.contact_load(kappa, oversampling, method_name)

    # Only CA steps a contact of two masses; for a contact between bodies a planner takes shorter
    # steps.
    title = "a hammer that bounces on a bar" + ("" if method_name == "ca" else ", by CA")
    return Map("contact", title, "κ of the contact at 44.1 kHz",
               _OVERSAMPLING_LABEL, _geometric_range(0.03, 3000.0, 21), _OVERSAMPLINGS, 0.25,
               _cases_over_oversampling(method_name, canonical.contact), load)  # fmt: skip


def _strike(method_name: str) -> Map:
    map_title = "a string whose springs harden, struck"
    if method_name == "modal":
        map_title += ", by CA"

    def load(speed: float, oversampling: float) -> float:
        return canonical.struck_load(speed, oversampling, method_name)

    return Map("strike", map_title, "speed of the stroke [m/s]",
               _OVERSAMPLING_LABEL, _geometric_range(0.1, 1000.0, 21), _OVERSAMPLINGS, 0.1,
               _cases_over_oversampling(method_name, canonical.struck), load)  # fmt: skip


def _rate(method_name: str) -> Map:
    def case(rate: float, mass_count: float) -> MapPoint:
        scene = canonical.string(round(mass_count), rate)
        return SteppedPoint(scene, Setting(method_name), _converged_truth(scene))

    def load(rate: float, mass_count: float) -> float:
        return canonical.string_load(mass_count, rate, method_name)

    counts = tuple(float(n) for n in (10, 14, 20, 28, 40, 57, 80, 113, 160))
    return Map("rate", "a string of many masses, 110 Hz", "rate [Hz]", "masses",
               _geometric_range(RATE / 16.3, RATE * 2.1, 17), counts, 0.1, case, load)  # fmt: skip


def _coupling(method_name: str) -> Map:
    def load(kappa: float, oversampling: float) -> float:
        return canonical.coupled_load(kappa, oversampling, method_name)

    return Map("coupling", "two cells joined by a spring", "κ of the joint at 44.1 kHz",
               _OVERSAMPLING_LABEL, _geometric_range(0.003, 300.0, 21), _OVERSAMPLINGS, 0.1,
               # The difference mode is high and decays slowly, so its phase needs a finer
               # reference.
               _cases_over_oversampling(
                   method_name, lambda kappa: canonical.coupled(kappa, method_name), 256),
               load)  # fmt: skip


# A key, and its label. Errors count as right if a plan calls the slow key preserved. Above 20
# frames a plan only reports the error, and the map keeps the limit of -70 dB.
_SLOW_KEYS = {
    "soft": (slow_key_scene.SOFT_KEY, "23 Hz"),
    "quick": (slow_key_scene.QUICK_KEY, "264 Hz, its last mass 1 g"),
}
_PRESERVED_LIMITS = ((10.0, -75.0), (inf, -70.0))


def _slow_key_map(map_name: str, slow_key: slow_key_scene.Key, modes_label: str) -> Map:
    def case(stiffness: float, frames_per_pull: float) -> MapPoint:
        return slow_key_scene.SlowKeyPoint(
            slow_key_scene.SlowKeyScene(slow_key, 1e3 * stiffness, round(frames_per_pull))
        )

    def load(stiffness: float, frames_per_pull: float) -> float:
        return slow_key_scene.eigenvalue_load(slow_key, 1e3 * stiffness)

    title = f"a slow key, modes to {modes_label}, pulls a string"
    pull_intervals = tuple(float(frames) for frames in range(2, 61, 2))
    return Map(map_name, title, "K of the spring between [kN/m]", "frames from pull to pull",
               _geometric_range(0.01, 1e3, 21), pull_intervals, 4.0, case, load,
               log_y=False, error_limits=_PRESERVED_LIMITS, judged_duration=1.0)  # fmt: skip


# --- a score ------------------------------------------------------------------------------------

_FACTORS = tuple(2.0**i for i in range(-2, 9))
_RATE_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)


def maps_of_score(piece: Piece, duration: float, method: str) -> dict[str, Map]:
    """Two maps: all springs stiffer, and, if there are contacts, contacts alone stiffer."""
    maps = [_stiffness_map(piece, duration, method, "springs", contacts_only=False)]
    if has_contacts(piece):
        maps.append(_stiffness_map(piece, duration, method, "contacts", contacts_only=True))
    return {survey_map.name: survey_map for survey_map in maps}


def _stiffness_map(
    piece: Piece, duration: float, method: str, map_name: str, *, contacts_only: bool
) -> Map:
    rate_factor_max = _RATE_FACTORS[-1]

    def scene(factor: float, rate_multiple: float) -> Score:
        stiffer_piece = stiffer(piece, factor, contacts_only=contacts_only)
        return Score(replace(stiffer_piece, rate=piece.rate * rate_multiple))

    @cache
    def reference_motion(factor: float) -> Motion | None:
        n_frames = round(duration * piece.rate * rate_factor_max) + 1
        return motion(scene(factor, rate_factor_max), n_frames, refinement=4)

    def case(factor: float, rate_multiple: float) -> MapPoint:
        def truth(n_frames: int) -> Truth:
            reference_run = reference_motion(factor)
            return (
                UNKNOWN
                if reference_run is None
                else reference_run.sampled(piece.rate * rate_multiple, n_frames)
            )

        return SteppedPoint(scene(factor, rate_multiple), _setting(method), truth)

    noun = "all its contacts" if contacts_only else "all its springs"
    title = f"{piece.title or 'the score'}: {noun} stiffer"
    return Map(map_name, title, "stiffness, times the score's", "rate, times the score's", _FACTORS,
               _RATE_FACTORS, duration, case, as_written=(1.0, 1.0))  # fmt: skip
