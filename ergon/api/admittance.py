"""Mechanical admittances: the velocity of points under a sinusoidal force, by frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .errors import OptionError
from .options import ReadOptions
from .parts import frequency_option, refuse_several_axes, target_named
from .pictures import Picture

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.instruments.model import Target

N_FREQUENCIES_DEFAULT = 1000
FREQUENCY_MIN_DEFAULT, FREQUENCY_MAX_DEFAULT = 20.0, 5000.0  # [Hz]


@dataclass(frozen=True, slots=True, kw_only=True)
class AdmittanceOptions(ReadOptions):
    """The frequencies at which an admittance is computed.

    These are `count` frequencies from `low` to `high`, spaced evenly by logarithm, or in Hz if
    `linear`; both ends are numbers [Hz] or texts such as "5kHz" and "A3". With `peaks` the
    resonances in between are added, so that none falls between two frequencies. `frequencies`
    (n,) [Hz] replace all of these.
    """

    low: float | str = FREQUENCY_MIN_DEFAULT
    high: float | str = FREQUENCY_MAX_DEFAULT
    count: int = N_FREQUENCIES_DEFAULT
    linear: bool = False
    peaks: bool = False
    frequencies: Sequence[float] | NDArray[np.float64] | None = None

    def axis(self) -> NDArray[np.float64]:
        """The frequencies [Hz] (n,), without those that `peaks` adds. Raises OptionError."""
        import numpy as np

        if self.frequencies is not None:
            frequencies = np.asarray(self.frequencies, dtype=float)
            if frequencies.ndim != 1 or not np.all(np.isfinite(frequencies) & (frequencies > 0)):
                raise OptionError("frequencies", "write a row of numbers above 0 [Hz]")
            return frequencies
        low_hertz = frequency_option("low", self.low)
        high_hertz = frequency_option("high", self.high)
        if not low_hertz < high_hertz:
            raise OptionError(
                "high", f"is {high_hertz:g} Hz; it must be above low, {low_hertz:g} Hz"
            )
        if self.count < 2:
            raise OptionError("count", f"is {self.count}; it must be at least 2")
        sample_axis = np.linspace if self.linear else np.geomspace
        return np.asarray(sample_axis(low_hertz, high_hertz, self.count))


@dataclass(frozen=True, slots=True)
class Admittance:
    """Velocities of points under a force at one point, of parts taken by themselves.

    `values` (n_observed, n_frequencies) [(m/s)/N] are complex: the velocity leads the force by
    their angle. `frequencies` (n_frequencies,) [Hz] rise. `forced` is the name of the point
    where the force acts, `observed` are the points whose velocity is given. If a point is several
    masses, the force acts on each, and their velocities are added up. A value is infinite at an
    undamped resonance.

    `n_laws` links with a law were taken at their slope at rest, `n_contacts` contacts as open.
    `inputs` are the files that the admittance was computed from.
    """

    parts: tuple[str, ...]
    forced: str
    observed: tuple[str, ...]
    frequencies: NDArray[np.float64]
    values: NDArray[np.complex128]
    n_laws: int
    n_contacts: int
    inputs: tuple[Path, ...]

    @property
    def decibels(self) -> NDArray[np.float64]:
        """Levels above 1 (m/s)/N [dB] (n_observed, n_frequencies)."""
        import numpy as np

        with np.errstate(divide="ignore"):
            return 20 * np.log10(np.abs(self.values))

    @property
    def phases(self) -> NDArray[np.float64]:
        """The angle by which the velocity leads the force [degrees] (n_observed, n_frequencies)."""
        import numpy as np

        return np.degrees(np.angle(self.values))

    def plot(self) -> Picture:
        """Levels over frequency. Raises OptionError for more points than can be told apart."""
        from ergon.view.curve import CURVES_MAX, Curve
        from ergon.view.structure import admittance as draw

        if len(self.observed) > CURVES_MAX:
            reason = f"draws at most {CURVES_MAX} points; name fewer"
            raise OptionError("svg", reason)
        frequency_list, levels = self.frequencies.tolist(), self.decibels.tolist()
        rows_by_output = zip(self.observed, levels, strict=True)
        curves = [
            Curve(f"velocity of {name}", frequency_list, levels_row)
            for name, levels_row in rows_by_output
        ]
        return Picture(draw(curves, title=f"Admittance: force at {self.forced}"))

    def _repr_svg_(self) -> str:
        return self.plot().svg

    def peaks(self, row: int) -> NDArray[np.intp]:
        """Indices of the local maxima of a point's level, from the highest level down."""
        import numpy as np

        magnitude = np.abs(self.values[row])
        maxima = (
            np.flatnonzero((magnitude[1:-1] > magnitude[:-2]) & (magnitude[1:-1] >= magnitude[2:]))
            + 1
        )
        return maxima[np.argsort(-magnitude[maxima], kind="stable")]


def admittance(
    score: str | Path,
    forced: str,
    observed: str | Sequence[str] = (),
    options: AdmittanceOptions | None = None,
    *,
    report: Report | None = None,
) -> Admittance:
    """The velocity of points `observed` per force at `forced`, by frequency; without
    `observed`, that of `forced`.

    The parts of these points are taken by themselves, with the links between them; contacts are
    open, and laws are taken at their slope at rest. The whole network is solved at each
    frequency. Raises ScoreError and OptionError.
    """
    from ergon.scores.staging.preparing import prepare

    options = options or AdmittanceOptions()
    frequencies = options.axis()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    observed_names = (observed,) if isinstance(observed, str) else tuple(observed) or (forced,)
    forced_point = target_named(piece, "forced", forced)
    observed_points = [target_named(piece, "observed", name) for name in observed_names]
    part_names = tuple(dict.fromkeys(target.part for target in (forced_point, *observed_points)))
    for index, target in enumerate((forced_point, *observed_points)):
        refuse_several_axes("observed" if index else "forced", piece, target.part)
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("solving"):
        built = prepare(piece).built_network
        network = built.network
        part_elements = [network.elements([part]) for part in part_names]
        if len({elements.ca_rate for elements in part_elements}) > 1:
            reason = "lies in a part whose `units` or rate differ from those of the force's part"
            raise OptionError("observed", reason)
        if options.peaks and options.frequencies is None:
            frequencies = _with_peaks(network, part_names, frequencies)
        mats_by_target = [
            _moving_mats(
                "observed" if index else "forced",
                target,
                built.assembly.members(target),
                part_elements,
            )
            for index, target in enumerate((forced_point, *observed_points))
        ]
        forced_mats, *observed_mats = mats_by_target
        values = network.admittance(list(part_names), forced_mats, observed_mats, frequencies)  # type: ignore[arg-type]
        kinds = network.elements(list(part_names)).kinds
    return Admittance(
        part_names,
        forced,
        observed_names,
        frequencies,
        values,
        sum(kind in ("LNL", "BRISTLE", "DRY") for kind in kinds),
        kinds.count("BUT"),
        tuple(loaded.inputs),
    )


def _moving_mats(
    option: str,
    forced_target: Target,
    candidates: Sequence[int],
    part_elements: Sequence[_core.Elements],
) -> list[int]:
    """Those of the MATs `candidates` that move. Raises OptionError if none does."""
    movable_mats = {mat for part in part_elements for mat in part.mats}
    moving_mats = [mat for mat in candidates if mat in movable_mats]
    if not moving_mats:
        raise OptionError(
            option, f"{forced_target.text} is fixed, so no force moves it; name a point that moves"
        )
    return moving_mats


def _with_peaks(
    network: _core.Network, part_names: Sequence[str], frequency_axis: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The frequencies, with the resonances between them added. Raises OptionError."""
    import numpy as np

    if len(part_names) > 1:
        raise OptionError(
            "peaks",
            f"peaks are those of one part; name points of one part, not of {', '.join(part_names)}",
        )
    poles = network.part_modes(part_names[0], to=float(frequency_axis[-1])).poles
    oscillating_poles = poles[(poles.real < 0.0) & (poles.imag > 0.0)]
    # Velocity is largest at the frequency that a mode has without its damping.
    resonances = np.abs(oscillating_poles) / (2 * np.pi)
    resonances_inside = resonances[
        (resonances > frequency_axis[0]) & (resonances < frequency_axis[-1])
    ]
    return np.unique(np.concatenate([frequency_axis, resonances_inside]))
