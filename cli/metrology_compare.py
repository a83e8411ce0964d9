"""`ergon metrology compare`, `log` and `weigh`: calibrations of keys compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.common.regular import read_bounded

from . import options
from .console import Console
from .options import Quantity
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.workshop.metrology.calibration_file import Calibration
    from ergon.workshop.metrology.comparison import Difference, Gain

_BYTES_MAX = 1 << 20  # largest calibration file
_DEVIATIONS_MAX = 3.0  # standard deviations: a larger difference is not chance


def read_calibration(calibration_path: str) -> Calibration:
    """Read a calibration that ergon metrology has written. Raises Refused if it is not one."""
    from ergon.workshop.metrology.calibration_file import read
    from ergon.workshop.metrology.gesture import MeasurementError

    try:
        calibration_bytes = read_bounded(Path(calibration_path), _BYTES_MAX)
        if len(calibration_bytes) > _BYTES_MAX:
            raise Refused(f"{calibration_path}: this file is larger than a calibration may be")
        return read(calibration_bytes.decode())
    except OSError as error:
        raise Refused(f"{calibration_path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise Refused(f"{calibration_path}: this file is not text") from None
    except MeasurementError as error:
        raise Refused(f"{calibration_path}: {error}") from None


@click.command()
@click.argument("first_path", metavar="A")
@click.argument("second_path", metavar="B")
@options.with_console
def compare(console: Console, first_path: str, second_path: str) -> None:
    """Compare two calibrations: figure by figure, and how differently the two keys move.

    The replay difference is the rms of the difference of both models under one gesture of knocks: a
    hand does not feel what lies below the step of the sensor. Modes of nearly one pitch are taken
    for the same mode. For a device against a calibration, see `ergon metrology replay`.
    """
    from ergon.workshop.metrology.comparison import chi_squared, differences, replay_difference

    first_calibration, second_calibration = (
        read_calibration(first_path),
        read_calibration(second_path),
    )
    figure_differences = differences(first_calibration, second_calibration)
    chi_square, n_figures = chi_squared(first_calibration, second_calibration)
    replay_rms = replay_difference(first_calibration.parameters, second_calibration.parameters)
    if console.json:
        for difference in figure_differences:
            console.record(
                "figure",
                name=_figure_name(difference),
                a=difference.first_value,
                b=difference.second_value,
                deviation=difference.deviation,
                deviations=difference.deviation_ratio,
            )
        console.record(
            "compared", replay_difference_m=replay_rms, chi_squared=chi_square, figures=n_figures
        )
        return
    console.data(f"{'':16}{'A':>12}{'B':>12}{'difference':>14}{'deviations':>12}\n")
    console.data("".join(map(_row, figure_differences)))
    console.data(f"replay difference {replay_rms * 1e6:.4g} um rms\n")
    _print_judgement(console, figure_differences, chi_square, n_figures)


def _figure_name(difference: Difference) -> str:
    """The name of a figure; with both numbers of its mode if the files number it differently."""
    figure_name, second_name = difference.names
    if figure_name == second_name or difference.second_value is None:
        return figure_name
    return (
        second_name
        if difference.first_value is None
        else f"{figure_name.partition('.')[0]}/{second_name.removeprefix('mode')}"
    )


def _row(difference: Difference) -> str:
    from ergon.workshop.metrology.calibration_file import MODE_FIELDS, UNITS

    figure_name = _figure_name(difference)
    mode, _, parameter_name = figure_name.partition(".")
    figure_unit, scale = MODE_FIELDS[parameter_name] if parameter_name else UNITS[figure_name]
    label = f"{mode.replace('mode', 'mode ')} {parameter_name}" if parameter_name else figure_name
    a, b = (
        f"{'none':>12}" if figure is None else f"{figure * scale:12.5g}"
        for figure in (difference.first_value, difference.second_value)
    )
    difference_text = (
        ""
        if difference.first_value is None or difference.second_value is None
        else f"{(difference.second_value - difference.first_value) * scale:.4g}"
    )
    deviations_text = (
        "" if difference.deviation_ratio is None else f"{difference.deviation_ratio:.3g}"
    )
    return (
        f"{label + ' [' + figure_unit + ']':16}{a}{b}{difference_text:>14}"
        f"{deviations_text:>12}".rstrip()
        + "\n"
    )


def _print_judgement(
    console: Console, figure_differences: list[Difference], chi_square: float, n_figures: int
) -> None:
    """Say which figures differ, and the chi squared of all together."""
    deviations = [
        (abs(difference.deviation_ratio), difference)
        for difference in figure_differences
        if difference.deviation_ratio is not None
    ]
    deviating = sorted(
        (pair for pair in deviations if pair[0] > _DEVIATIONS_MAX), key=lambda pair: -pair[0]
    )
    in_one_file_only = [
        _figure_name(difference)
        for difference in figure_differences
        if difference.first_value is None or difference.second_value is None
    ]
    if deviating:
        deviating_text = ", ".join(
            f"{_figure_name(difference)} by {sigma:.3g}" for sigma, difference in deviating
        )
        console.say(f"more than {_DEVIATIONS_MAX:g} standard deviations apart: {deviating_text}")
    elif deviations:
        console.say(f"no figure differs by more than {_DEVIATIONS_MAX:g} standard deviations")
    if in_one_file_only:
        console.say(f"only one has {', '.join(in_one_file_only)}")
    if n_figures:
        console.say(
            f"chi squared {chi_square:.3g} of {n_figures} figures with their covariance; of one "
            f"key about {n_figures}"
        )


@click.command()
@click.argument("files", metavar="CALIBRATION...", nargs=-1, required=True)
@options.with_console
def log(console: Console, files: tuple[str, ...]) -> None:
    """List calibrations of a key by their dates, and how differently each moves from the first.

    The last column is the replay difference of `ergon metrology compare`.
    """
    from ergon.workshop.metrology.comparison import replay_difference

    calibrations = sorted(
        ((read_calibration(file), file) for file in files),
        key=lambda calibration_and_file: calibration_and_file[0].date,
    )
    if not console.json:
        console.data(
            f"{'date':12}{'M [g]':>10}{'K [N/m]':>10}{'Z [Ns/m]':>10}{'dry [mN]':>10}"
            f"{'moves [um]':>12}{'modes [Hz]':>16}   file\n"
        )
    first_calibration, _ = calibrations[0]
    for calibration_read, calibration_path in calibrations:
        replay_rms = replay_difference(first_calibration.parameters, calibration_read.parameters)
        figure_values = calibration_read.figures
        if console.json:
            console.record(
                "calibration",
                file=calibration_path,
                date=calibration_read.date,
                figures=figure_values,
                replay_difference_m=replay_rms,
            )
            continue
        modes = " ".join(f"{frequency:.5g}" for _, frequency, _ in calibration_read.modes) or "none"
        console.data(
            f"{calibration_read.date or '?':12}{figure_values['M'] * 1e3:10.5g}"
            f"{figure_values['K']:10.5g}{figure_values['Z']:10.4g}"
            f"{figure_values.get('dry', 0.0) * 1e3:10.4g}{replay_rms * 1e6:12.4g}{modes:>16}   "
            f"{calibration_path}\n"
        )


@click.command()
@click.argument("plain", metavar="WITHOUT")
@click.argument("loaded", metavar="WITH")
@click.option(
    "--mass", type=Quantity("MASS"), required=True, help="The mass that WITH has more, weighed."
)
@options.with_console
def weigh(console: Console, plain: str, loaded: str, mass: float) -> None:
    """Find what a device makes of newtons and metres, from a key without and with a weighed mass.

    Both calibrations are of one key. The mass found grows by the weighed one times the gains of
    sensor and motor together; where the key sinks under the weight, each gain is found by itself.
    """
    from ergon.workshop.metrology.comparison import gains
    from ergon.workshop.metrology.gesture import MeasurementError

    try:
        measured_gains = gains(read_calibration(plain), read_calibration(loaded), mass)
    except MeasurementError as error:
        raise Refused(str(error)) from None
    if console.json:
        field_by_gain = {"mass": "mass_gain", "position": "position_gain", "force": "force_gain"}
        gain_fields: dict[str, float | None] = {}
        for gain_name in ("mass", "position", "force", "M", "K", "Z"):
            gain = measured_gains.get(gain_name)
            gain_fields[field_by_gain.get(gain_name, gain_name)] = (
                None if gain is None else gain.value
            )
            gain_fields[f"{field_by_gain.get(gain_name, gain_name)}_deviation"] = (
                None if gain is None else gain.deviation
            )
        console.record("gains", **gain_fields)
        return
    console.data(
        f"true over found: {_gain_text(measured_gains['mass'])}; so M is "
        f"{_gain_text(measured_gains['M'], 1e3)} g, "
        f"K {_gain_text(measured_gains['K'])} N/m, Z {_gain_text(measured_gains['Z'])} Ns/m\n"
    )
    if "position" not in measured_gains:
        console.say(
            "the key does not sink under the mass, so the gains of sensor and motor are not known "
            "apart from each other"
        )
    else:
        console.data(f"the sensor reads {_gain_text(measured_gains['position'])} m for a metre\n")
        console.data(f"the motor gives {_gain_text(measured_gains['force'])} N for a newton\n")


def _gain_text(gain: Gain, scale: float = 1.0) -> str:
    """A figure and its standard deviation."""
    text = f"{scale * gain.value:.5g}"
    return text if gain.deviation is None else f"{text} ± {scale * gain.deviation:.2g}"
