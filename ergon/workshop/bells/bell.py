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
_SAME = 5.0  # standard deviations within which two strokes have one mode
_LEAST_APART = 0.02  # [Hz]
_NEAR = 0.04  # over a decay [Hz·s]: a quarter of the width of a partial
_ONE = 0.01  # over a decay [Hz·s]: nearer modes of one stroke are one, found twice
_FAINT = 1e-7  # of the energy of every stroke: what other modes left
_PEAK = 0.5  # of full scale: all modes of a table together
_FIRST = np.arange(-0.003, 0.003, 1e-5)  # [s] where the middle of a stroke may lie


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

    `heard` are levels at the place of listening. A stroke at a place moves a mode there by the
    product of both levels; the largest product is 1. `reference` is the amplitude of that
    largest product in the recording of the hardest stroke (full scale is 1). `energy` is each
    mode's share of the energy of the loudest stroke. Standard deviations are None if the modes
    come from a table.
    """

    f: Array
    t60: Array
    places: tuple[str, ...]
    levels: Array
    heard: Array
    energy: Array
    deviation: Uncertainty | None
    strokes: tuple[StrokeReport, ...]
    contact: float
    reference: float

    @property
    def pitch(self) -> float:
        """The frequency [Hz] of the mode that is loudest at the beginning."""
        return float(self.f[int(np.argmax(np.abs(self.levels[:, 0] * self.heard)))])


def of_strokes(strokes: Sequence[tuple[str, Stroke]], count: int | None = None) -> Bell:
    """The bell that made these strokes, each given with its place; its `count` loudest modes.

    Raises NotAStrokeError if modes leave more than a quarter of the energy of a stroke.
    """
    found = []
    for _, one in strokes:
        own, rest = find_modes(one.sound, one.rate)
        left = float(np.sum(rest**2) / np.sum(one.sound**2))
        if not own.f.size or left > RESIDUAL_ENERGY_MAX:
            what = "none of it" if not own.f.size else f"only {100.0 * (1.0 - left):.0f} % of it"
            message = (
                f"{one.name}: it is not a single stroke of something that rings: damped modes "
            )
            raise NotAStrokeError(message + f"explain {what}; 75 % is the least")
        found.append((own, uncertainty(own, rest, one.rate)))
    f, d = _merged_modes(found)
    fits = [_fit(one, f, d) for _, one in strokes]
    shares = np.stack([fit.energy for fit in fits]).max(axis=0)
    loudest = np.argsort(shares)[::-1][:count]
    kept = np.sort(loudest[shares[loudest] > _FAINT])
    if kept.size < f.size:
        f, d = f[kept], d[kept]
        fits = [_fit(one, f, d) for _, one in strokes]
    return _bell([place for place, _ in strokes], [one for _, one in strokes], fits)


@dataclass(frozen=True)
class _Fit:
    """One stroke fitted by the common modes: the modes when the stroke began, and the share
    explained.
    """

    modes: Modes
    deviation: Uncertainty
    energy: Array
    explained: float


def _fit(stroke: Stroke, f: Array, d: Array) -> _Fit:
    modes, rest = fit_amplitudes(stroke.sound, stroke.rate, f, d)
    whole = float(np.sum(stroke.sound**2)) / stroke.rate
    energy = modes.energy(stroke.sound.size / stroke.rate) / whole
    explained = 1.0 - float(np.sum(rest**2)) / stroke.rate / whole
    deviation = uncertainty(modes, rest, stroke.rate)
    first = Modes(f, d, modes.c * np.exp(-modes.poles * stroke.delay))
    return _Fit(first, deviation, energy, explained)


def _merged_modes(found: Sequence[tuple[Modes, Uncertainty]]) -> tuple[Array, Array]:
    """f and d of all modes; a mode found in several strokes appears once."""
    rows = [
        (float(f), float(d), float(max(sf, 1e-9)), float(max(sd, 1e-9)), at)
        for at, (modes, own) in enumerate(found)
        for f, d, sf, sd in zip(modes.f, modes.d, own.f, own.d, strict=True)
    ]
    groups: list[list[tuple[float, float, float, float, int]]] = []
    for row in sorted(rows):
        near = [
            group
            for group in groups[-4:]
            if (row[4] not in {one[4] for one in group} or row[0] - group[0][0] < _ONE * row[1])
            and abs(row[0] - group[0][0])
            <= max(_SAME * float(np.hypot(row[2], group[0][2])), _LEAST_APART, _NEAR * row[1])
        ]
        if near:
            min(near, key=lambda group: abs(row[0] - group[0][0])).append(row)
        else:
            groups.append([row])
    f: list[float] = []
    d: list[float] = []
    for group in groups:
        table = np.array(group)
        for own, at in ((f, 0), (d, 1)):
            weight = 1.0 / table[:, at + 2] ** 2
            own.append(float(np.sum(table[:, at] * weight) / np.sum(weight)))
    order = np.argsort(f)
    return np.array(f)[order], np.array(d)[order]


def _bell(places: Sequence[str], strokes: Sequence[Stroke], fits: Sequence[_Fit]) -> Bell:
    modes = fits[0].modes
    names = tuple(dict.fromkeys(places))
    table = np.zeros((modes.f.size, len(names)))
    heard: dict[int, tuple[float, float | None]] = {}
    lengths = []
    for column, name in enumerate(names):
        own = [i for i, place in enumerate(places) if place == name]
        amplitudes = np.stack([np.abs(fits[i].modes.c) for i in own])
        errors = np.stack([fits[i].deviation.level for i in own])
        told = contact.levels(modes.f, amplitudes, errors)
        hardest = own[int(np.argmax(told.impulses))]
        table[:, column] = told.levels * _signs(fits[hardest].modes)
        shortest = told.lengths[int(np.argmax(told.impulses))]
        lengths += [] if shortest is None else [shortest]
        for i, impulse, length in zip(own, told.impulses, told.lengths, strict=True):
            heard[i] = float(impulse), length
    length = min(lengths, default=contact.LENGTH)
    reference = float(np.abs(table).max())
    table /= reference
    listened, levels = _split(table)
    loudest = max(fits, key=lambda fit: float(np.sum(np.abs(fit.modes.c) ** 2)))
    best = [np.min([getattr(fit.deviation, what) for fit in fits], axis=0) for what in "fd"]
    level = np.min([fit.deviation.level for fit in fits], axis=0)
    told_strokes = tuple(
        StrokeReport(one.name, place, *heard[i], fits[i].explained)
        for i, (place, one) in enumerate(zip(places, strokes, strict=True))
    )
    return Bell(
        modes.f,
        LN_1000 / modes.d,
        names,
        levels,
        listened,
        loudest.energy,
        Uncertainty(best[0], best[1], level),
        told_strokes,
        length,
        reference,
    )


def _split(table: Array) -> tuple[Array, Array]:
    """Split products of levels (n, places) into levels at the place of listening and at the struck
    places.
    """
    loudest = int(np.argmax(np.sum(table**2, axis=0)))
    own = np.abs(table[:, loudest])
    least = 1e-3 * np.abs(table).max(axis=1)
    heard: Array = np.sqrt(np.maximum(np.maximum(own, least), 1e-12))
    return heard, np.asarray(table / heard[:, None])


def _signs(modes: Modes) -> Array:
    """Signs of the modes. At the instant of the push all modes have the same phase or the opposite
    one.
    """
    weight = np.abs(modes.c) ** 0.5
    phase = np.angle(modes.c)
    turns = phase[None, :] + 2.0 * np.pi * _FIRST[:, None] * modes.f[None, :]
    together = np.exp(2j * turns) @ weight
    at = int(np.argmax(np.abs(together)))
    signs = np.where(np.cos(turns[at] - 0.5 * np.angle(together[at])) >= 0.0, 1.0, -1.0)
    return np.asarray(signs * signs[int(np.argmax(np.abs(modes.c)))])


def of_table(rows: Sequence[tuple[float, float, float]], count: int | None = None) -> Bell:
    """The bell of a table of resonances, each f [Hz], t60 [s] and amplitude; the loudest `count`.

    A table has no full scale: the amplitudes of all modes together are set to half of it.
    """
    kept = sorted(rows, key=lambda row: -(row[2] ** 2) * row[1])[: count or len(rows)]
    f, t60, a = (np.array(column) for column in zip(*sorted(kept), strict=True))
    heard, levels = _split((a / np.abs(a).max())[:, None])
    energy = a * a * t60
    whole = sum(row[2] ** 2 * row[1] for row in rows)
    reference = _PEAK / float(np.sum(np.abs(levels[:, 0] * heard)))
    told = contact.LENGTH, reference
    return Bell(f, t60, ("point",), levels, heard, energy / whole, None, (), *told)
