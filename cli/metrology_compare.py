"""`ergon metrology compare`, `log` and `weigh`: calibrations of keys, one beside the other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.common.regular import open_regular

from . import options
from .console import Console
from .emulate import Quantity
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.metrology.calibration_file import Calibration

# Figures in the order of a table: unit, and units of it in one SI unit.
_SHOWN = (
    ("M", "g", 1e3),
    ("K", "N/m", 1.0),
    ("Z", "Ns/m", 1.0),
    ("rest", "mm", 1e3),
    ("weight", "mN", 1e3),
    ("dry", "mN", 1e3),
    ("presliding", "N/m", 1.0),
    ("static", "mN", 1e3),
    ("static_speed", "mm/s", 1e3),
    ("delay", "ms", 1e3),
)


def calibration(file: str) -> Calibration:
    """A calibration that ergon metrology has written. Refused where it is none."""
    from ergon.metrology.calibration_file import read
    from ergon.metrology.gesture import MeasurementError

    try:
        with open_regular(Path(file)) as opened:
            return read(opened.read().decode())
    except OSError as error:
        raise Refused(f"{file}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise Refused(f"{file}: this is no text") from None
    except MeasurementError as error:
        raise Refused(f"{file}: {error}") from None


@click.command()
@click.argument("one", metavar="A")
@click.argument("other", metavar="B")
@options.speaking
def compare(console: Console, one: str, other: str) -> None:
    """Compare two calibrations: figure by figure, and how differently the two keys move.

    The replay difference is the rms of the difference of both models under one gesture of knocks: a
    hand does not feel what lies below the step of the sensor. For a device against a calibration,
    see `ergon metrology replay`.
    """
    from ergon.metrology.comparison import chi_squared, replay_difference

    first, second = calibration(one), calibration(other)
    if not console.json:
        console.data(f"{'':14}{'A':>12}{'B':>12}{'difference':>14}{'deviations':>12}\n")
    for name, unit, scale in _SHOWN:
        a, b = first.figures.get(name), second.figures.get(name)
        if a is None and b is None:
            continue
        sigma = None
        if name in first.deviations and name in second.deviations:
            sigma = (first.deviations[name] ** 2 + second.deviations[name] ** 2) ** 0.5
        if console.json:
            console.record("figure", name=name, a=a, b=b, deviation=sigma)
            continue
        apart = (b or 0.0) - (a or 0.0)
        told = [f"{x * scale:12.5g}" if x is not None else f"{'none':>12}" for x in (a, b)]
        far = f"{apart / sigma:12.3g}" if sigma else f"{'':12}"
        console.data(f"{name + ' [' + unit + ']':14}{told[0]}{told[1]}{apart * scale:14.4g}{far}\n")
    squared, n = chi_squared(first, second)
    moves = replay_difference(first.row, second.row)
    if console.json:
        console.record("compared", replay_difference_m=moves, chi_squared=squared, figures=n)
        return
    console.data(f"replay difference {moves * 1e6:.4g} um rms\n")
    if n:
        console.say(f"chi squared {squared:.3g} of {n} figures")


@click.command()
@click.argument("files", metavar="CALIBRATION...", nargs=-1, required=True)
@options.speaking
def log(console: Console, files: tuple[str, ...]) -> None:
    """List calibrations of a key by their dates, and how differently each moves from the first.

    The last column is the replay difference, as `ergon metrology compare` has it.
    """
    from ergon.metrology.comparison import replay_difference

    known = sorted(((calibration(file), file) for file in files), key=lambda one: one[0].date)
    if not console.json:
        console.data(
            f"{'date':12}{'M [g]':>10}{'K [N/m]':>10}{'Z [Ns/m]':>10}{'dry [mN]':>10}"
            f"{'moves [um]':>12}   file\n"
        )
    for each, file in known:
        moves = replay_difference(known[0][0].row, each.row)
        own = each.figures
        if console.json:
            console.record(
                "calibration", file=file, date=each.date, figures=own, replay_difference_m=moves
            )
            continue
        console.data(
            f"{each.date or '?':12}{own['M'] * 1e3:10.5g}{own['K']:10.5g}{own['Z']:10.4g}"
            f"{own.get('dry', 0.0) * 1e3:10.4g}{moves * 1e6:12.4g}   {file}\n"
        )


@click.command()
@click.argument("plain", metavar="WITHOUT")
@click.argument("loaded", metavar="WITH")
@click.option(
    "--mass", type=Quantity("MASS"), required=True, help="The mass that WITH has more, weighed."
)
@options.speaking
def weigh(console: Console, plain: str, loaded: str, mass: float) -> None:
    """Find what a device makes of newtons and metres, from a key without and with a weighed mass.

    Both calibrations are of one key. The mass found grows by the weighed one times the gains of
    sensor and motor together; where the key sinks under the weight, each gain is found by itself.
    """
    from ergon.metrology.comparison import gains
    from ergon.metrology.gesture import MeasurementError

    without = calibration(plain)
    try:
        gain, reads = gains(without, calibration(loaded), mass)
    except MeasurementError as error:
        raise Refused(str(error)) from None
    own = without.figures
    pushes = None if reads is None else gain / reads
    if console.json:
        console.record(
            "gains",
            mass_gain=gain,
            position_gain=reads,
            force_gain=pushes,
            M=gain * own["M"],
            K=gain * own["K"],
            Z=gain * own["Z"],
        )
        return
    console.data(
        f"true over found: {gain:.5g}; so M is {gain * own['M'] * 1e3:.5g} g, "
        f"K {gain * own['K']:.5g} N/m, Z {gain * own['Z']:.4g} Ns/m\n"
    )
    if reads is None or pushes is None:
        console.say(
            "the key does not sink under the mass, so the gains of sensor and motor are not known "
            "apart from each other"
        )
    else:
        console.data(f"the sensor reads {reads:.5g} m for a metre\n")
        console.data(f"the motor gives {pushes:.5g} N for a newton\n")
