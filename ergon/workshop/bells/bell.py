"""A struck object from one or several strokes: modes, levels at places, contact of the hammer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ergon.common.decay import LN_1000
from ergon.workshop.bells import contact
from ergon.workshop.bells.bands import Array
from ergon.workshop.bells.modes import Modes, Uncertainty, find_modes, fit_amplitudes, uncertainty
from ergon.workshop.bells.stroke import NotAStrokeError, Stroke

RESIDUAL_ENERGY_MAX = 0.25  # of the energy that modes may leave (-6 dB)
_SAME_MODE_DEVIATIONS = 5.0  # standard deviations within which two strokes have one mode
_LEAST_APART = 0.02  # [Hz]
_NEAR_WIDTHS = 0.04  # over a decay [Hz·s]: a quarter of the width of a partial
_SAME_MODE = 0.01  # over a decay [Hz·s]: nearer modes of one stroke are one, found twice
_FAINT = 1e-7  # of the energy of every stroke: what other modes left
_PEAK = 0.5  # share of full scale for all modes of a table together
_STROKE_OFFSETS = np.arange(-0.003, 0.003, 1e-5)  # [s] where the middle of a stroke may lie


@dataclass(frozen=True)
class StrokeReport:
    """One stroke: its place, relative impulse, length of contact [s] if known, and the share of its
    energy that modes explain.
    """

    name: str
    place: str
    impulse: float
    contact: float | None
    explained: float


@dataclass(frozen=True)
class Bell:
    """A struck object: modes from low to high, each (n,), and their levels at places (n, places).

    `listened` are levels at the place of listening. A stroke at a place moves a mode there by the
    product of both levels; the largest product is 1. `reference` is the amplitude of that
    largest product in the recording of the hardest stroke (full scale is 1). `energy` is each
    mode's share of the energy of the loudest stroke. Standard deviations are None if the modes
    come from a table.
    """

    f: Array
    t60: Array
    places: tuple[str, ...]
    levels: Array
    listened: Array
    energy: Array
    deviation: Uncertainty | None
    strokes: tuple[StrokeReport, ...]
    contact: float
    reference: float

    @property
    def pitch(self) -> float:
        """The frequency [Hz] of the mode that is loudest at the beginning."""
        return float(self.f[int(np.argmax(np.abs(self.levels[:, 0] * self.listened)))])


def bell_from_strokes(strokes: Sequence[tuple[str, Stroke]], mode_count: int | None = None) -> Bell:
    """The bell that made these strokes, each given with its place; its `mode_count` loudest modes.

    Raises NotAStrokeError if modes leave more than a quarter of the energy of a stroke.
    """
    stroke_modes = []
    for _, recorded in strokes:
        recorded_modes, residual = find_modes(recorded.sound, recorded.rate)
        residual_share = float(np.sum(residual**2) / np.sum(recorded.sound**2))
        if not recorded_modes.f.size or residual_share > RESIDUAL_ENERGY_MAX:
            problem = (
                "none of it"
                if not recorded_modes.f.size
                else f"only {100.0 * (1.0 - residual_share):.0f} % of it"
            )
            message = (
                f"{recorded.name}: it is not a single stroke of something that rings: damped modes "
            )
            raise NotAStrokeError(message + f"explain {problem}; 75 % is the least")
        stroke_modes.append((recorded_modes, uncertainty(recorded_modes, residual, recorded.rate)))
    mode_frequencies, decay_rates = _merged_modes(stroke_modes)
    fits = [_fit(recorded, mode_frequencies, decay_rates) for _, recorded in strokes]
    shares = np.stack([fit.energy for fit in fits]).max(axis=0)
    loudest = np.argsort(shares)[::-1][:mode_count]
    audible = np.sort(loudest[shares[loudest] > _FAINT])
    if audible.size < mode_frequencies.size:
        mode_frequencies, decay_rates = mode_frequencies[audible], decay_rates[audible]
        fits = [_fit(recorded, mode_frequencies, decay_rates) for _, recorded in strokes]
    return _bell([place for place, _ in strokes], [recorded for _, recorded in strokes], fits)


@dataclass(frozen=True)
class _Fit:
    """One stroke fitted by the common modes: the modes when the stroke began, and the share
    explained.
    """

    modes: Modes
    deviation: Uncertainty
    energy: Array
    explained: float


def _fit(stroke: Stroke, mode_frequencies: Array, decay_rates: Array) -> _Fit:
    modes, residual = fit_amplitudes(stroke.sound, stroke.rate, mode_frequencies, decay_rates)
    stroke_energy = float(np.sum(stroke.sound**2)) / stroke.rate
    energy = modes.energy(stroke.sound.size / stroke.rate) / stroke_energy
    explained = 1.0 - float(np.sum(residual**2)) / stroke.rate / stroke_energy
    deviation = uncertainty(modes, residual, stroke.rate)
    modes_at_stroke = Modes(
        mode_frequencies, decay_rates, modes.c * np.exp(-modes.poles * stroke.delay)
    )
    return _Fit(modes_at_stroke, deviation, energy, explained)


def _merged_modes(modes_and_errors: Sequence[tuple[Modes, Uncertainty]]) -> tuple[Array, Array]:
    """f and d of all modes; a mode found in several strokes appears once."""
    mode_rows = [
        (float(f), float(d), float(max(sf, 1e-9)), float(max(sd, 1e-9)), stroke_index)
        for stroke_index, (modes, errors) in enumerate(modes_and_errors)
        for f, d, sf, sd in zip(modes.f, modes.d, errors.f, errors.d, strict=True)
    ]
    mode_groups: list[list[tuple[float, float, float, float, int]]] = []
    for mode_row in sorted(mode_rows):
        near_groups = [
            group
            for group in mode_groups[-4:]
            if (
                mode_row[4] not in {row_in_group[4] for row_in_group in group}
                or mode_row[0] - group[0][0] < _SAME_MODE * mode_row[1]
            )
            and abs(mode_row[0] - group[0][0])
            <= max(
                _SAME_MODE_DEVIATIONS * float(np.hypot(mode_row[2], group[0][2])),
                _LEAST_APART,
                _NEAR_WIDTHS * mode_row[1],
            )
        ]
        if near_groups:
            min(near_groups, key=lambda group: abs(mode_row[0] - group[0][0])).append(mode_row)
        else:
            mode_groups.append([mode_row])
    mode_frequencies: list[float] = []
    decay_rates: list[float] = []
    for group in mode_groups:
        group_table = np.array(group)
        for errors, stroke_index in ((mode_frequencies, 0), (decay_rates, 1)):
            weight = 1.0 / group_table[:, stroke_index + 2] ** 2
            errors.append(float(np.sum(group_table[:, stroke_index] * weight) / np.sum(weight)))
    order = np.argsort(mode_frequencies)
    return np.array(mode_frequencies)[order], np.array(decay_rates)[order]


def _bell(stroke_places: Sequence[str], strokes: Sequence[Stroke], fits: Sequence[_Fit]) -> Bell:
    bell_modes = fits[0].modes
    place_names = tuple(dict.fromkeys(stroke_places))
    level_table = np.zeros((bell_modes.f.size, len(place_names)))
    impulse_and_length: dict[int, tuple[float, float | None]] = {}
    contact_lengths = []
    for place_index, name in enumerate(place_names):
        place_rows = [i for i, place in enumerate(stroke_places) if place == name]
        amplitudes = np.stack([np.abs(fits[i].modes.c) for i in place_rows])
        errors = np.stack([fits[i].deviation.level for i in place_rows])
        contact_levels = contact.levels(bell_modes.f, amplitudes, errors)
        hardest = place_rows[int(np.argmax(contact_levels.impulses))]
        level_table[:, place_index] = contact_levels.levels * _signs(fits[hardest].modes)
        shortest = contact_levels.lengths[int(np.argmax(contact_levels.impulses))]
        contact_lengths += [] if shortest is None else [shortest]
        for i, impulse, contact_length in zip(
            place_rows, contact_levels.impulses, contact_levels.lengths, strict=True
        ):
            impulse_and_length[i] = float(impulse), contact_length
    contact_length = min(contact_lengths, default=contact.LENGTH)
    reference = float(np.abs(level_table).max())
    level_table /= reference
    listened, levels = _split(level_table)
    loudest = max(fits, key=lambda fit: float(np.sum(np.abs(fit.modes.c) ** 2)))
    best_fits = [
        np.min([getattr(fit.deviation, field_name) for fit in fits], axis=0) for field_name in "fd"
    ]
    level_deviation = np.min([fit.deviation.level for fit in fits], axis=0)
    stroke_contacts = tuple(
        StrokeReport(recorded.name, place, *impulse_and_length[i], fits[i].explained)
        for i, (place, recorded) in enumerate(zip(stroke_places, strokes, strict=True))
    )
    return Bell(
        bell_modes.f,
        LN_1000 / bell_modes.d,
        place_names,
        levels,
        listened,
        loudest.energy,
        Uncertainty(best_fits[0], best_fits[1], level_deviation),
        stroke_contacts,
        contact_length,
        reference,
    )


def _split(level_table: Array) -> tuple[Array, Array]:
    """Split products of levels (n, places) into levels at the place of listening and at the struck
    places.
    """
    loudest = int(np.argmax(np.sum(level_table**2, axis=0)))
    loudest_level = np.abs(level_table[:, loudest])
    least = 1e-3 * np.abs(level_table).max(axis=1)
    loudness: Array = np.sqrt(np.maximum(np.maximum(loudest_level, least), 1e-12))
    return loudness, np.asarray(level_table / loudness[:, None])


def _signs(bell_modes: Modes) -> Array:
    """Signs of the modes. At the instant of the push all modes have the same phase or the opposite
    one.
    """
    weight = np.abs(bell_modes.c) ** 0.5
    phase = np.angle(bell_modes.c)
    turns = phase[None, :] + 2.0 * np.pi * _STROKE_OFFSETS[:, None] * bell_modes.f[None, :]
    phasor_sums = np.exp(2j * turns) @ weight
    loudest_row = int(np.argmax(np.abs(phasor_sums)))
    signs = np.where(
        np.cos(turns[loudest_row] - 0.5 * np.angle(phasor_sums[loudest_row])) >= 0.0, 1.0, -1.0
    )
    return np.asarray(signs * signs[int(np.argmax(np.abs(bell_modes.c)))])


def bell_from_table(
    resonance_rows: Sequence[tuple[float, float, float]], mode_count: int | None = None
) -> Bell:
    """The bell of a table of resonances, each f [Hz], t60 [s] and amplitude; the loudest
    `mode_count`.

    A table has no full scale: the amplitudes of all modes together are set to half of it.
    """
    loudest_rows = sorted(resonance_rows, key=lambda row: -(row[2] ** 2) * row[1])[
        : mode_count or len(resonance_rows)
    ]
    f, t60, a = (np.array(column) for column in zip(*sorted(loudest_rows), strict=True))
    loudness, place_levels = _split((a / np.abs(a).max())[:, None])
    energy = a * a * t60
    energy_total = sum(row[2] ** 2 * row[1] for row in resonance_rows)
    reference = _PEAK / float(np.sum(np.abs(place_levels[:, 0] * loudness)))
    reference_contact = contact.LENGTH, reference
    return Bell(
        f,
        t60,
        ("point",),
        place_levels,
        loudness,
        energy / energy_total,
        None,
        (),
        *reference_contact,
    )
