"""Counts and totals of the parts of a score: masses, links, modes by third octave, energies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.option import documented, option, renamed
from ergon.common.report import Report

from . import score as scores
from .modes import PartModes, compute_modes, find_points
from .options import ReadOptions
from .parts import frequency_option, selected_parts, stretches_no_spring

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.instruments.model import Module
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.built_network import BuiltNetwork

_STATIC_FREQUENCY_RATIO = (
    1e-5  # of the lowest frequency: there inertia changes the response by this squared
)
_ENERGY_SHARE_MIN = 1e-12  # share of a blow's energy that counts as none


@renamed(to="upto")
@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class StatsOptions(ReadOptions):
    """Which parts are described; without names, all.

    A frequency is a number [Hz] or a text such as "5kHz" and "A7".
    """

    parts: Sequence[str] = ()
    upto: float | str = option(
        "5kHz", "Count modes up to this frequency.", metavar="FREQUENCY", shown=True
    )


@dataclass(frozen=True, slots=True)
class LinkStats:
    """Links of one kind: how many, and the lowest and the highest K [N/m] and Z [N·s/m] of them.

    `kind` is CEL (a tie to the ground), RES, FRO, REF, BUT, LNL, BRISTLE or DRY. Links with a
    law count with their slopes at rest, a BUT with its values while it is closed.
    """

    kind: str
    count: int
    stiffness: tuple[float, float]
    damping: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PointStats:
    """A point where a part is struck, touched or heard.

    `mass` [kg] is the sum of its masses, `compliance` [m/N] its displacement under a constant
    force of 1 N, infinite if nothing holds the part. `shares` (n_modes,) are the shares of the
    modes in the energy of a blow there, and `centroid` [Hz] is the mean of their frequencies,
    weighted by these shares.
    """

    name: str
    mass: float
    compliance: float
    shares: NDArray[np.float64]
    centroid: float


@dataclass(frozen=True, slots=True)
class PartStats:
    """Figures of one part by itself, contacts open and laws at their slope at rest.

    `masses` [kg] are the lightest and the heaviest, `n_held` counts the fixed and imposed
    points. `modes` are those up to the frequency asked for; the first `n_free` of them stretch
    no spring, such as the rigid motion of a free body. `third_octaves` (n_bands,) [Hz] are the
    centres of the bands that the others lie in, `counts` (n_bands,) how many lie in each.
    `highest` [Hz] is |s|/2π of the highest of all modes. `guarantee` is that of the scheme at
    the score's rate, with `oversampling` steps a frame: "proved", "guarded" or "tried"; None if
    no number of steps up to 16 is known to be stable. `mode_masses` [kg] are the `M` of each
    MODES by its name, the mass of a mode at a point of level 1; `mass` and `masses` are instead
    those of the network that moves like such a body.
    """

    part: str
    n_masses: int
    n_held: int
    mass: float
    masses: tuple[float, float]
    links: tuple[LinkStats, ...]
    modes: PartModes
    n_free: int
    third_octaves: NDArray[np.float64]
    counts: NDArray[np.intp]
    highest: float
    guarantee: str | None
    oversampling: int
    points: tuple[PointStats, ...]
    inputs: tuple[Path, ...]
    mode_masses: Mapping[str, float]


def stats(
    score: str | Path, options: StatsOptions | None = None, *, report: Report | None = None
) -> tuple[PartStats, ...]:
    """Counts and totals of parts of a score, each without its links to others.

    Raises ScoreError and OptionError.
    """
    from ergon.scores.staging.preparing import prepare

    options = options or StatsOptions()
    frequency_max = frequency_option("upto", options.upto)
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    part_names = selected_parts(piece, options.parts)
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("computing modes"):
        built = prepare(piece).built_network
        return tuple(
            _part_stats(piece, built, name, frequency_max, loaded.inputs) for name in part_names
        )


def _part_stats(
    piece: Piece,
    built: BuiltNetwork,
    part_name: str,
    frequency_max: float,
    input_files: Sequence[Path],
) -> PartStats:
    import numpy as np

    elements = built.network.elements([part_name])
    part_modes = compute_modes(piece, built, part_name, {"to": frequency_max}, input_files)
    n_free = int(stretches_no_spring(part_modes.shapes, elements).sum())
    frequencies = part_modes.frequencies[n_free:]
    centres, counts = _third_octave_counts(frequencies[frequencies > 0])
    guarantee, oversampling = _part_certificate(piece, part_name)
    mats = elements.mats
    indices_by_point = find_points(piece, built, part_name, mats)
    return PartStats(
        part_name,
        len(mats),
        elements.n_held,
        float(elements.masses.sum()),
        (float(elements.masses.min()), float(elements.masses.max())) if mats else (0.0, 0.0),
        tuple(_link_stats(elements)),
        part_modes,
        n_free,
        centres,
        counts,
        _highest_frequency(built.network, part_name, elements),
        guarantee,
        oversampling,
        tuple(
            _point_stats(
                built.network, part_name, elements, part_modes, label, np.array(mass_indices)
            )
            for label, mass_indices in indices_by_point.items()
        ),
        tuple(input_files),
        {
            module.name: module.fields["M"]
            for module in _modules_of(piece, part_name)
            if module.kind == "MODES"
        },
    )


def _modules_of(piece: Piece, name: str) -> Sequence[Module]:
    part = piece.instruments.get(name) or piece.keys.get(name)
    return () if part is None else part.modules


def _link_stats(elements: _core.Elements) -> Sequence[LinkStats]:
    import numpy as np

    kinds = np.array(elements.kinds)
    link_stats = []
    for link_kind in dict.fromkeys(elements.kinds):
        stiffnesses = elements.stiffness[kinds == link_kind]
        dampings = elements.damping[kinds == link_kind]
        k_range, z_range = ((float(x.min()), float(x.max())) for x in (stiffnesses, dampings))
        link_stats.append(LinkStats(link_kind, len(stiffnesses), k_range, z_range))
    return link_stats


def _third_octave_counts(
    frequencies: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Centres of the third octaves from the lowest frequency to the highest, and how many lie in
    each.
    """
    import numpy as np

    if not frequencies.size:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    band_numbers = np.round(3 * np.log2(frequencies / 1000)).astype(int)
    lowest_band = int(band_numbers.min())
    counts = np.bincount(band_numbers - lowest_band)
    return 1000 * 2 ** ((lowest_band + np.arange(len(counts))) / 3), counts


def _highest_frequency(network: _core.Network, part_name: str, elements: _core.Elements) -> float:
    """The highest mode's frequency without damping [Hz]: that of the mode nearest to an upper
    bound, or the bound where no mode is found.
    """
    import numpy as np

    if not elements.mats:
        return 0.0
    stiffness = np.where([kind == "BUT" for kind in elements.kinds], 0.0, elements.stiffness)
    diagonal_stiffness = np.zeros(len(elements.mats) + 1)  # index -1 is a held end
    np.add.at(diagonal_stiffness, elements.a, stiffness)
    np.add.at(diagonal_stiffness, elements.b, stiffness)
    ratio_max = float(
        (diagonal_stiffness[:-1] / elements.masses).max()
    )  # λ is at most twice this (Gershgorin)
    if ratio_max <= 0:
        return 0.0
    rate = elements.ca_rate
    bound = np.sqrt(2.002 * ratio_max)
    frequency = (
        bound / (2 * np.pi) if rate is None else rate * np.arcsin(min(1.0, bound / 2)) / np.pi
    )
    poles = network.part_modes(part_name, around=float(frequency), count=1).poles
    if not poles.size or not np.isfinite(poles[0]):
        return float(frequency)
    return float(abs(poles[0]) if rate is None else abs(poles[0].imag)) / (2 * np.pi)


def _part_certificate(piece: Piece, part_name: str) -> tuple[str | None, int]:
    """The guarantee of a part by itself, and the steps a frame that it holds for."""
    from ergon import _core
    from ergon.scores.edits.tunable import TunablePart

    network = TunablePart(piece, part_name).network({})
    for oversampling in (1, 2, 4, 8, 16):
        try:
            certificate = network.certify(piece.rate * oversampling)
        except (_core.UnstableError, _core.UnsureError):
            continue
        return certificate.guarantee, oversampling * certificate.oversampling
    return None, 1


def _point_stats(
    network: _core.Network,
    part_name: str,
    elements: _core.Elements,
    part_modes: PartModes,
    point_label: str,
    mass_indices: NDArray[np.intp],
) -> PointStats:
    import numpy as np

    masses = elements.masses[mass_indices]
    energy_shares = np.abs(part_modes.points[point_label]) ** 2 / np.sum(1 / masses)
    total_share = float(energy_shares.sum())
    centroid = (
        float(energy_shares @ part_modes.frequencies / total_share) if total_share > 0 else 0.0
    )
    mats = [elements.mats[mass_index] for mass_index in mass_indices]
    compliance = np.inf
    lowest_modes = network.part_modes(part_name, count=1)
    # A mass that only a damper holds has a pole at 0: a constant force moves it without bound.
    # Points that no such mode moves still have a finite compliance.
    oscillates = part_modes.frequencies > 0
    lowest_omega = 2 * np.pi * min(part_modes.frequencies[oscillates], default=0.0)
    slowest_rate = float(np.abs(lowest_modes.poles[:1]).sum() or lowest_omega)
    if not isfinite(slowest_rate):  # a discrete network may be at rest within a frame
        slowest_rate = 2 * np.pi * (elements.ca_rate or 0.0)
    is_pushed_away = (
        bool((energy_shares[~oscillates] > _ENERGY_SHARE_MIN).any()) or slowest_rate == 0
    )
    if not is_pushed_away and not stretches_no_spring(lowest_modes.shapes, elements).any():
        frequency = _STATIC_FREQUENCY_RATIO * slowest_rate / (2 * np.pi)
        admittance = network.admittance([part_name], mats, [mats], [frequency])[0, 0]
        compliance = float((admittance / (2j * np.pi * frequency)).real)
    return PointStats(point_label, float(masses.sum()), compliance, energy_shares, centroid)
