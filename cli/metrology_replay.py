"""`ergon metrology replay`: the same gesture on a key and on its model."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from . import metrology_score, options
from .console import Console
from .metrology_compare import read_calibration
from .metrology_fit import gesture, write_texts
from .options import Quantity
from .outcome import Refused
from .view import serve_shown

if TYPE_CHECKING:
    from ergon.workshop.metrology.comparison import Replay
    from ergon.workshop.metrology.gesture import Floats, Gesture

_WARNING_RATIO = 5.0  # times the noise of the sensor
_WIDTH_MAX = 160  # columns: wider is harder to read, not finer
_PLOT_HEIGHTS = (6, 10, 7)  # lines: asked, real and model, residual


@click.command()
@click.argument("file", metavar="CALIBRATION")
@click.argument("real", metavar="DEVICE|TAKE")
@click.option("--hand", metavar="NAME", help="The hand of a take with several.")
@metrology_score.chosen
@click.option("--no-gate", is_flag=True, help="As for `ergon metrology DEVICE`.")
@click.option(
    "--force-step", type=Quantity("FORCE"), default=0.0, help="As for `ergon metrology DEVICE`."
)
@click.option(
    "--width", type=click.IntRange(24, 1000), help="Width in characters. Default: the terminal's."
)
@options.target("Write a picture of asked, real, model and residual into this SVG file.")
@click.option("--view", is_flag=True, help="Show all four in a browser then, until Ctrl-C.")
@options.view_at
@options.force
@options.dry_run
@options.with_console
def replay(
    console: Console,
    file: str,
    real: str,
    hand: str | None,
    score: str | None,
    key: str | None,
    no_gate: bool,
    force_step: float,
    width: int | None,
    output: str | None,
    view: bool,
    view_at: str | None,
    force: bool,
    dry: bool,
) -> None:
    """Give a key and the model of a calibration the same gesture, and compare their motions.

    A device is pushed by the ladder and then by knocks, or along what --score plays on a key, and
    must not be touched; of a take the recorded gesture counts. Drawn are the force that was asked
    for, the real key and its model, and the residual (real less model); the table has the residual
    of each second, also in steps of the sensor. --view shows the four in a browser as curves that
    run, until Ctrl-C.
    """
    from ergon.exchange.safe import check_target
    from ergon.workshop.metrology import comparison
    from ergon.workshop.metrology.gesture import sensor_noise, sensor_step

    key_calibration = read_calibration(file)
    if output is not None:
        check_target(Path(output), force=force, inputs=[Path(file)])
    is_take = Path(real).is_file()
    if is_take and score is not None:
        raise Refused(
            "--score is for a key of a device; a take has its own gesture: leave --score out"
        )
    led_path = metrology_score.played_path(console, score, key)
    measured_gesture = (
        gesture(console, Path(real), hand, force_step)
        if is_take
        else _push_device(console, real, led_path, force_step=force_step, gated=not no_gate)
    )
    motion_comparison = comparison.replay(key_calibration.parameters, measured_gesture)
    if not console.json:
        console.data(_plot_text(motion_comparison, width))
    _print_residuals(
        console,
        motion_comparison,
        sensor_noise([measured_gesture]),
        sensor_step([measured_gesture]),
    )
    if output is not None:
        from ergon.workshop.metrology.picture import picture

        title = f"{real} and {file}"
        write_texts(
            console, {Path(output): picture(motion_comparison, title)}, force=force, dry=dry
        )
    if view or view_at is not None:
        _show(console, motion_comparison, view_at)


def _push_device(
    console: Console, device: str, path: Floats | None, *, force_step: float, gated: bool
) -> Gesture:
    """Push a key of a device with knocks, or with forces that lead it along a path."""
    from ergon.workshop.metrology.gesture import MeasurementError
    from ergon.workshop.metrology.ladder import climb
    from ergon.workshop.metrology.takes import held_out_duration, record

    from .metrology_measure import open_axis

    device_axis, _ = open_axis(device, force_step=force_step, gated=gated)
    console.say("let go of the key: it is pushed now, gently at first")
    try:
        takes = record(
            climb(device_axis),
            "held-out",
            held_out_duration(path),
            lambda kind, part: None,
            path=path,
        )
    except MeasurementError as error:
        raise Refused(f"{device}: {error}") from None
    finally:
        device_axis.device.close()
    return max((take.gesture for take in takes), key=lambda measured: len(measured.force))


def _plot_text(motion_comparison: Replay, picture_width: int | None) -> str:
    """Force, real and model motion, residual: one plot above the other, over the same time."""
    from ergon.view.braille import panels
    from ergon.workshop.metrology.picture import replay_panels

    columns = picture_width or min(shutil.get_terminal_size().columns, _WIDTH_MAX)
    return panels(replay_panels(motion_comparison), width=columns, heights=_PLOT_HEIGHTS)


def _show(console: Console, motion_comparison: Replay, address: str | None) -> None:
    """Show force, real motion, model and residual in a browser, until Ctrl-C."""
    from ergon.api.options import FileOptions
    from ergon.api.pages import ANY_LOCAL_PORT
    from ergon.api.viewing import render_view
    from ergon.common.report import Report
    from ergon.workshop.metrology.replay_scene import write_scene

    with TemporaryDirectory(prefix="ergon-replay-") as folder_name:
        folder = Path(folder_name)
        options = FileOptions(motion=True, see="all")
        shown = render_view(write_scene(motion_comparison, folder), folder, options, Report())
        serve_shown(console, shown, address or ANY_LOCAL_PORT, [])


def _print_residuals(
    console: Console, motion_comparison: Replay, noise: float | None, position_step: float | None
) -> None:
    import numpy as np

    step_head = "" if position_step is None else f"{'of step':>9}"
    if not console.json:
        console.data(
            f"\n{'s':>5}{'real':>12}{'residual':>14}{step_head}{'at most':>12}{step_head}\n"
        )
    seconds = motion_comparison.instants.astype(int)
    measured_position = motion_comparison.gesture.position[motion_comparison.gesture.is_compared]
    for second in np.unique(seconds):
        is_in_second = seconds == second
        residual = motion_comparison.residual[is_in_second]
        travel = float(np.ptp(measured_position[is_in_second]))
        rms, largest = float(np.sqrt(np.mean(residual**2))), float(np.abs(residual).max())
        if console.json:
            console.record("second", s=int(second), real_m=travel, rms_m=rms, most_m=largest)
        else:
            residual_texts = (
                f"{_residual_text(rms, 11, position_step)}"
                f"{_residual_text(largest, 9, position_step)}"
            )
            residual_columns = f"{travel * 1e3:9.3g} mm{residual_texts}"
            console.data(f"{second:5d}{residual_columns}\n")
    if console.json:
        console.record(
            "replay",
            rms_m=motion_comparison.rms,
            most_m=motion_comparison.residual_max,
            noise_m=noise,
            step_m=position_step,
        )
        return
    residual_columns = (
        f"{_residual_text(motion_comparison.rms, 11, position_step)}"
        f"{_residual_text(motion_comparison.residual_max, 9, position_step)}"
    )
    console.data(f"{'all':>5}{'':12}{residual_columns}\n")
    if noise is not None:
        # Real and model are compared as the sensor reads them: an exact model leaves the sensor's
        # noise.
        excess = max(motion_comparison.rms**2 - noise**2, 0.0) ** 0.5
        step_share = "" if position_step is None else f" ({excess / position_step:.3g} of its step)"
        console.say(
            f"the sensor's noise is {noise * 1e6:.3g} um; beyond it the model is off by "
            f"{excess * 1e6:.3g} um{step_share}"
            + (": measure the key again" if excess > _WARNING_RATIO * noise else "")
        )


def _residual_text(residual: float, width: int, step: float | None) -> str:
    """A residual in um and, if the sensor's step is known, in such steps."""
    return f"{residual * 1e6:{width}.4g} um" + ("" if step is None else f"{residual / step:9.3g}")
