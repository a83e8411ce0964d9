"""`ergon metrology DEVICE`: a key measured by its response to forces."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import metrology_fit, metrology_score, options
from .console import Console
from .options import Quantity
from .outcome import DeviceMissing, Refused

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.calibration import AxisCalibration as Known
    from ergon.workshop.metrology.gesture import Floats
    from ergon.workshop.metrology.ladder import Axis, Ladder, Rung
    from ergon.workshop.metrology.takes import Take


@click.command()
@click.argument("device", metavar="DEVICE")
@click.option(
    "--seconds",
    type=options.Number(2, 600, "DURATION"),
    default=10.0,
    show_default=True,
    help="Length of the take of strikes, and of the take of rain.",
)
@click.option(
    "--force-max", type=Quantity("FORCE"), help="Greatest force, where less than the device's."
)
@click.option(
    "--force-step",
    type=Quantity("FORCE"),
    default=0.0,
    help="Step of the motor's force, where the device rounds more than its wire.",
)
@click.option(
    "--no-gate",
    is_flag=True,
    help="The firmware lets forces through without a touch, whatever its kind usually does.",
)
@metrology_score.chosen
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the forces.")
@options.target("Write the calibration into this file; takes and report have its name.")
@options.force
@options.dry_run
@options.with_console
def measure(
    console: Console,
    device: str,
    seconds: float,
    force_max: float | None,
    force_step: float,
    no_gate: bool,
    score: str | None,
    key: str | None,
    seed: int,
    output: str | None,
    force: bool,
    dry: bool,
) -> None:
    """Measure a key of a device, which must not be touched meanwhile.

    DEVICE is a URL or a name of your list, with its axis: frame:/dev/ttyACM0#1, tgr0.1. The key is
    pushed so little at first that it hardly moves, then more and more (a ladder), and never near
    an end of its travel. Then come takes of strikes, of single ticks of random sign (rain), and a
    held-out gesture, of knocks or along what --score plays on a key, which judges the parts of the
    model. What a key is made of is then found as by `ergon metrology fit`. Ctrl-C ends every force
    at once.
    """
    from ergon.exchange.safe import check_target
    from ergon.workshop.metrology.gesture import MeasurementError

    if output is None and not dry:
        raise Refused("-o FILE says where the calibration is written; -n writes nothing")
    path = None if dry or output is None else Path(output)
    if path is not None:
        check_target(path, force=force)
        check_target(path.with_suffix(".svg"), force=force)
    score_forces = metrology_score.played_path(console, score, key)
    device_axis, url = open_axis(
        device, force_max=force_max, force_step=force_step, gated=not no_gate
    )
    recorder = Recorder(path, take_header(url, device_axis.number))
    try:
        try:
            ladder = _climb_ladder(console, device_axis, seed)
            takes = _record_takes(console, ladder, seconds, recorder, seed, score_forces)
        finally:
            device_axis.device.close()
    except MeasurementError as error:
        recorder.report_kept(console)
        raise Refused(f"{device}: {error}") from None
    except KeyboardInterrupt:
        recorder.report_kept(console)
        raise
    *fitted, held_out = takes
    metrology_fit.report(
        console,
        [take.gesture for take in fitted],
        held_out.gesture,
        recorder.paths,
        path,
        force=force,
        dry=dry,
    )


def open_axis(
    device: str,
    *,
    force_max: float | None = None,
    force_step: float = 0.0,
    gated: bool = True,
) -> tuple[Axis, str]:
    """An open axis of a device in the user's list or of a URL, and the URL. Raises Refused,
    DeviceMissing.
    """
    from ergon import _core
    from ergon.live.boards import BoardError, device_urls, url_and_axis
    from ergon.live.calibration import stored_calibrations
    from ergon.workshop.metrology.ladder import Axis

    try:
        url, axis_index = url_and_axis(device, {} if ":" in device else device_urls())
        calibrations: dict[int, Known] = stored_calibrations(url)
    except BoardError as error:
        raise Refused(str(error)) from None
    try:
        open_device = _core.Device(
            url, [axis.for_core(number) for number, axis in calibrations.items()]
        )
    except _core.EngineError as error:
        raise DeviceMissing(str(error)) from None
    if open_device.unit != "m" or axis_index >= open_device.axes:
        open_device.close()
        raise Refused(
            f"{url}: axis {axis_index} does not exist: the device has {open_device.axes}, counted "
            "from "
            "0"
            if open_device.unit == "m"
            else f"{url}: the axis rotates (its unit is rad), and the model of a key is in metres"
        )
    # A Haply device does not report touch.
    return (
        Axis(
            open_device,
            axis_index,
            force_step=force_step,
            tells_touch=not url.startswith("haply:"),
            is_gated=gated,
            force_max=force_max,
        ),
        url,
    )


def take_header(url: str, axis_index: int) -> str:
    """The header of a take of an axis, as JSON."""
    from ergon import _core
    from ergon.live.boards import Board
    from ergon.live.calibration import axis_header, stored_calibrations

    return json.dumps(
        {
            "made": f"by ergon {_core.__version__}",
            "day": time.strftime("%Y-%m-%d %H:%M:%S"),
            "sent": "wire",
            "axes": [axis_header(Board(url, (), stored_calibrations(url)), axis_index)],
        }
    )


@dataclass(slots=True)
class Recorder:
    """Chooses the files of takes: beside the calibration `path`, each under a free name.

    `paths` are those of the takes so far.
    """

    path: Path | None
    about: str
    paths: list[Path] = field(default_factory=list)

    def target(self, kind: str, part: int) -> _core.RecordTarget | None:
        """The file of a take; None where nothing is written."""
        from ergon import _core

        if self.path is None:
            return None
        take_number = 0
        while True:
            take_number += 1
            take_path = self.path.with_name(
                f"{self.path.stem}.{kind}{'' if take_number == 1 else f'-{take_number}'}.take"
            )
            if not take_path.exists():
                break
        self.paths.append(take_path)
        return _core.RecordTarget(take_path, [("key", "")], self.about)

    def report_kept(self, console: Console) -> None:
        """Name the takes that were kept, after a measurement that ended early."""
        written_paths = [str(path) for path in self.paths if path.exists()]
        if written_paths:
            console.say(f"kept {', '.join(written_paths)}")


def _climb_ladder(console: Console, axis: Axis, seed: int) -> Ladder:
    from ergon.workshop.metrology.ladder import climb

    console.say("let go of the key: it is pushed now, gently at first")

    def report_rung(rung: Rung) -> None:
        if console.json:
            console.record(
                "rung", force_N=rung.force, excursion_m=rung.excursion, braked=rung.is_braked
            )

    ladder = climb(axis, seed, report_rung)
    forces_text = " ".join(
        f"{rung.force:.3g}{'!' if rung.is_braked else ''}" for rung in ladder.rungs
    )
    farthest_mm = max(rung.excursion for rung in ladder.rungs) * 1e3
    console.say(
        f"rungs: {forces_text} N, at most {farthest_mm:.2g} of "
        f"{ladder.guide.half_travel * 1e3:.3g} mm"
        + (" (! was braked)" if any(rung.is_braked for rung in ladder.rungs) else "")
    )
    if ladder.axis.sign < 0:
        console.say(
            "the motor pushes in the opposite direction; this measurement corrects that, and "
            "`ergon devices calibrate` turns it for scores"
        )
    if ladder.needs_guide:
        console.say("the key has almost no spring, so a soft virtual spring holds it in place")
    return ladder


def _record_takes(
    console: Console,
    ladder: Ladder,
    take_seconds: float,
    recorder: Recorder,
    seed: int,
    score_forces: Floats | None,
) -> list[Take]:
    """Takes of strikes and rain, then one that is held out."""
    from ergon.workshop.metrology import takes

    recorded_takes: list[Take] = []
    phrases = []
    for take_kind in takes.KINDS:
        duration = (
            takes.held_out_duration(score_forces) if take_kind == "held-out" else take_seconds
        )
        takes_of_kind = takes.record(
            ladder, take_kind, duration, recorder.target, seed, score_forces
        )
        lasted_seconds = sum(len(take.gesture.force) / take.gesture.rate for take in takes_of_kind)
        phrases.append(f"{take_kind} {lasted_seconds:.0f} s")
        # Only the longest part of the held-out take judges the model; the others are left out.
        recorded_takes += (
            [max(takes_of_kind, key=lambda take: len(take.gesture.force))]
            if take_kind == "held-out"
            else takes_of_kind
        )
    console.say(f"takes: {', '.join(phrases)}")
    return recorded_takes
