"""A struck object from one or several strokes: modes, levels at places, contact of the hammer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ergon.common.decay import LN_1000
from ergon.workshop.bells import contact
from ergon.workshop.bells.bands import Array
from ergon.workshop.bells.modes import (
    Modes,
    Uncertainty,
    find_modes,
    fit_amplitudes,
    mode_uncertainty,
)
from ergon.workshop.bells.stroke import NotAStrokeError, Stroke

RESIDUAL_ENERGY_MAX = 0.25  # of the energy that modes may leave (-6 dB)
_MATCH_DEVIATIONS = 5.0  # standard deviations within which two strokes have one mode
_MATCH_DISTANCE_MIN = 0.02  # [Hz]
_MATCH_WIDTH_RATIO = 0.04  # over a decay [Hz·s]: a quarter of the width of a partial
_DUPLICATE_WIDTH_RATIO = (
    0.01  # over a decay [Hz·s]: nearer modes of one stroke are one, found twice
)
_ENERGY_SHARE_MIN = 1e-7  # of the energy of every stroke: a weaker mode is a remainder of others
_TABLE_PEAK = 0.5  # share of full scale for all modes of a table together
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

    `listening_levels` are levels at the place of listening. A stroke at a place moves a mode there
    by the product of both levels; the largest product is 1. `reference` is the amplitude of that
    largest product in the recording of the hardest stroke (full scale is 1). `energy` is each
    mode's share of the energy of the loudest stroke. Standard deviations are None if the modes come
    from a table.
    """

    f: Array
    t60: Array
    places: tuple[str, ...]
    levels: Array
    listening_levels: Array
    energy: Array
    deviation: Uncertainty | None
    strokes: tuple[StrokeReport, ...]
    contact: float
    reference: float

    @property
    def pitch(self) -> float:
        """The frequency [Hz] of the mode that is loudest at the beginning."""
        return float(self.f[int(np.argmax(np.abs(self.levels[:, 0] * self.listening_levels)))])


def bell_from_strokes(strokes: Sequence[tuple[str, Stroke]], n_modes: int | None = None) -> Bell:
    """The bell that made these strokes, each given with its place; its `n_modes` loudest modes.

    Raises NotAStrokeError if modes leave more than a quarter of the energy of a stroke.
    """
    modes_and_errors = []
    for _, stroke in strokes:
        modes, residual = find_modes(stroke.sound, stroke.rate)
        residual_share = float(np.sum(residual**2) / np.sum(stroke.sound**2))
        if not modes.frequencies.size or residual_share > RESIDUAL_ENERGY_MAX:
            explained = (
                "none of it"
                if not modes.frequencies.size
                else f"only {100.0 * (1.0 - residual_share):.0f} % of it"
            )
            message = (
                f"{stroke.name}: it is not a single stroke of something that rings: damped modes "
            )
            raise NotAStrokeError(message + f"explain {explained}; 75 % is the least")
        modes_and_errors.append((modes, mode_uncertainty(modes, residual, stroke.rate)))
    frequencies, decays = _merged_modes(modes_and_errors)
    fits = [_fit(stroke, frequencies, decays) for _, stroke in strokes]
    energy_shares = np.stack([fit.energy_shares for fit in fits]).max(axis=0)
    loudest = np.argsort(energy_shares)[::-1][:n_modes]
    audible = np.sort(loudest[energy_shares[loudest] > _ENERGY_SHARE_MIN])
    if audible.size < frequencies.size:
        frequencies, decays = frequencies[audible], decays[audible]
        fits = [_fit(stroke, frequencies, decays) for _, stroke in strokes]
    return _bell_of_fits([place for place, _ in strokes], [stroke for _, stroke in strokes], fits)


@dataclass(frozen=True)
class _Fit:
    """One stroke fitted by the common modes: the modes when the stroke began, and the share
    explained.
    """

    modes: Modes
    deviation: Uncertainty
    energy_shares: Array
    explained: float


def _fit(stroke: Stroke, frequencies: Array, decays: Array) -> _Fit:
    modes, residual = fit_amplitudes(stroke.sound, stroke.rate, frequencies, decays)
    stroke_energy = float(np.sum(stroke.sound**2)) / stroke.rate
    energy_shares = modes.energy(stroke.sound.size / stroke.rate) / stroke_energy
    explained = 1.0 - float(np.sum(residual**2)) / stroke.rate / stroke_energy
    deviation = mode_uncertainty(modes, residual, stroke.rate)
    modes_at_push = Modes(
        frequencies, decays, modes.amplitudes * np.exp(-modes.poles * stroke.delay)
    )
    return _Fit(modes_at_push, deviation, energy_shares, explained)


class _ModeEstimate(NamedTuple):
    """A mode as one stroke has it; the deviations are standard deviations of the first two."""

    frequency: float
    decay: float
    frequency_deviation: float
    decay_deviation: float
    stroke_index: int


def _merged_modes(modes_and_errors: Sequence[tuple[Modes, Uncertainty]]) -> tuple[Array, Array]:
    """f and d of all modes; a mode found in several strokes appears once."""
    estimates = [
        _ModeEstimate(
            float(f), float(d), float(max(f_error, 1e-9)), float(max(d_error, 1e-9)), stroke_index
        )
        for stroke_index, (modes, errors) in enumerate(modes_and_errors)
        for f, d, f_error, d_error in zip(
            modes.frequencies, modes.decays, errors.frequencies, errors.decays, strict=True
        )
    ]
    groups: list[list[_ModeEstimate]] = []
    for estimate in sorted(estimates):
        near_groups = [
            group
            for group in groups[-4:]
            if (
                estimate.stroke_index not in {member.stroke_index for member in group}
                or estimate.frequency - group[0].frequency < _DUPLICATE_WIDTH_RATIO * estimate.decay
            )
            and abs(estimate.frequency - group[0].frequency)
            <= max(
                _MATCH_DEVIATIONS
                * float(np.hypot(estimate.frequency_deviation, group[0].frequency_deviation)),
                _MATCH_DISTANCE_MIN,
                _MATCH_WIDTH_RATIO * estimate.decay,
            )
        ]
        if near_groups:
            min(near_groups, key=lambda group: abs(estimate.frequency - group[0].frequency)).append(
                estimate
            )
        else:
            groups.append([estimate])
    frequency_means: list[float] = []
    decay_means: list[float] = []
    for group in groups:
        table = np.array(group)
        for means, column in ((frequency_means, 0), (decay_means, 1)):
            weights = 1.0 / table[:, column + 2] ** 2
            means.append(float(np.sum(table[:, column] * weights) / np.sum(weights)))
    order = np.argsort(frequency_means)
    return np.array(frequency_means)[order], np.array(decay_means)[order]


def _bell_of_fits(
    stroke_places: Sequence[str], strokes: Sequence[Stroke], fits: Sequence[_Fit]
) -> Bell:
    modes = fits[0].modes
    place_names = tuple(dict.fromkeys(stroke_places))
    products = np.zeros((modes.frequencies.size, len(place_names)))
    push_by_stroke: dict[int, tuple[float, float | None]] = {}
    hardest_contact_lengths = []
    for column, place_name in enumerate(place_names):
        stroke_indices = [
            stroke_index for stroke_index, place in enumerate(stroke_places) if place == place_name
        ]
        amplitudes = np.stack(
            [np.abs(fits[stroke_index].modes.amplitudes) for stroke_index in stroke_indices]
        )
        errors = np.stack(
            [fits[stroke_index].deviation.relative_amplitudes for stroke_index in stroke_indices]
        )
        level_fit = contact.fit_levels(modes.frequencies, amplitudes, errors)
        hardest_index = stroke_indices[int(np.argmax(level_fit.impulses))]
        products[:, column] = level_fit.levels * _signs(fits[hardest_index].modes)
        hardest_contact_length = level_fit.lengths[int(np.argmax(level_fit.impulses))]
        hardest_contact_lengths += (
            [] if hardest_contact_length is None else [hardest_contact_length]
        )
        for stroke_index, impulse, contact_length in zip(
            stroke_indices, level_fit.impulses, level_fit.lengths, strict=True
        ):
            push_by_stroke[stroke_index] = float(impulse), contact_length
    contact_length = min(hardest_contact_lengths, default=contact.DEFAULT_CONTACT_DURATION)
    reference = float(np.abs(products).max())
    products /= reference
    listening_levels, levels = _split_levels(products)
    loudest_fit = max(fits, key=lambda fit: float(np.sum(np.abs(fit.modes.amplitudes) ** 2)))
    deviations = [
        np.min([getattr(fit.deviation, field_name) for fit in fits], axis=0)
        for field_name in ("frequencies", "decays")
    ]
    level_deviation = np.min([fit.deviation.relative_amplitudes for fit in fits], axis=0)
    reports = tuple(
        StrokeReport(
            recorded.name, place, *push_by_stroke[stroke_index], fits[stroke_index].explained
        )
        for stroke_index, (place, recorded) in enumerate(zip(stroke_places, strokes, strict=True))
    )
    return Bell(
        modes.frequencies,
        LN_1000 / modes.decays,
        place_names,
        levels,
        listening_levels,
        loudest_fit.energy_shares,
        Uncertainty(deviations[0], deviations[1], level_deviation),
        reports,
        contact_length,
        reference,
    )


def _split_levels(products: Array) -> tuple[Array, Array]:
    """Split products of levels (n, places) into levels at the place of listening and at the struck
    places.
    """
    loudest_column = int(np.argmax(np.sum(products**2, axis=0)))
    reference_levels = np.abs(products[:, loudest_column])
    level_floor = 1e-3 * np.abs(products).max(axis=1)
    listening_levels: Array = np.sqrt(np.maximum(np.maximum(reference_levels, level_floor), 1e-12))
    return listening_levels, np.asarray(products / listening_levels[:, None])


def _signs(modes: Modes) -> Array:
    """Signs of the modes. At the instant of the push all modes have the same phase or the opposite
    one.
    """
    weights = np.abs(modes.amplitudes) ** 0.5
    phases = np.angle(modes.amplitudes)
    push_phases = (
        phases[None, :] + 2.0 * np.pi * _STROKE_OFFSETS[:, None] * modes.frequencies[None, :]
    )
    phasor_sums = np.exp(2j * push_phases) @ weights
    best_offset = int(np.argmax(np.abs(phasor_sums)))
    signs = np.where(
        np.cos(push_phases[best_offset] - 0.5 * np.angle(phasor_sums[best_offset])) >= 0.0,
        1.0,
        -1.0,
    )
    return np.asarray(signs * signs[int(np.argmax(np.abs(modes.amplitudes)))])


def bell_from_table(
    resonances: Sequence[tuple[float, float, float]], n_max: int | None = None
) -> Bell:
    """The bell of a table of resonances, each f [Hz], t60 [s] and amplitude; the loudest
    `n_max`.

    A table has no full scale: the amplitudes of all modes together are set to half of it.
    """
    loudest = sorted(resonances, key=lambda row: -(row[2] ** 2) * row[1])[
        : n_max or len(resonances)
    ]
    f, t60, amplitudes = (np.array(column) for column in zip(*sorted(loudest), strict=True))
    listening_levels, levels = _split_levels((amplitudes / np.abs(amplitudes).max())[:, None])
    energy = amplitudes * amplitudes * t60
    energy_total = sum(row[2] ** 2 * row[1] for row in resonances)
    reference = _TABLE_PEAK / float(np.sum(np.abs(levels[:, 0] * listening_levels)))
    contact_and_reference = contact.DEFAULT_CONTACT_DURATION, reference
    return Bell(
        f,
        t60,
        ("point",),
        levels,
        listening_levels,
        energy / energy_total,
        None,
        (),
        *contact_and_reference,
    )
