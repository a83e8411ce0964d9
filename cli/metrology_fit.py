"""`ergon metrology fit`: a key measured from takes of the forces that it was given."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.common.regular import file_digest

from . import options
from .console import Console
from .options import Quantity
from .outcome import Findings, Refused
from .recording import read

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ergon.workshop.metrology.gesture import Gesture
    from ergon.workshop.metrology.judging import Stage
    from ergon.workshop.metrology.stages import Measured

_NOISE_RATIO_MAX = 3.0  # times the sensor's noise: beyond it the model does not explain the key


@click.command()
@click.argument("takes", metavar="TAKE...", nargs=-1, required=True)
@click.option(
    "--held-out",
    metavar="TAKE",
    help="A take that only judges which parts stay; otherwise the last quarter of the last TAKE.",
)
@click.option(
    "--hand", metavar="NAME", help="The hand whose axis is measured, where takes have several."
)
@click.option(
    "--force-step",
    type=Quantity("FORCE"),
    default=0.0,
    help="Step of the motor's force, where the device rounded more than its wire.",
)
@options.target("Write the calibration into this file, for `calib: FILE` of a key.")
@options.force
@options.dry_run
@options.with_console
def fit(
    console: Console,
    takes: tuple[str, ...],
    held_out: str | None,
    hand: str | None,
    force_step: float,
    output: str | None,
    force: bool,
    dry: bool,
) -> None:
    """Measure a key by takes of the forces that it was given.

    Nobody may touch the key while such a take is recorded, and each begins with the key at rest.
    Mass, spring and damper are found first, then dry friction, its presliding and static level
    (Stribeck), the delay of the forces, and modes. A part stays only if it is worth its numbers
    (the Bayesian information criterion falls) and a held-out gesture is followed better. A part
    that was refused is tried again after each one that stays.
    """
    from ergon.exchange.safe import check_target

    paths = [Path(take) for take in takes]
    held_out_path = None if held_out is None else Path(held_out)
    held_out_paths = [] if held_out_path is None else [held_out_path]
    if output is not None:
        check_target(Path(output), force=force, inputs=(*paths, *held_out_paths))
        check_target(
            Path(output).with_suffix(".svg"), force=force, inputs=(*paths, *held_out_paths)
        )
    gestures = [gesture(console, path, hand, force_step) for path in paths]
    held_out_gesture = (
        None if held_out_path is None else gesture(console, held_out_path, hand, force_step)
    )
    all_gestures = gestures if held_out_gesture is None else [*gestures, held_out_gesture]
    if len({gesture.rate for gesture in all_gestures}) > 1:
        raise Refused("the takes are of different rates; measure by takes of one rate")
    target = None if output is None else Path(output)
    report(
        console, gestures, held_out_gesture, [*paths, *held_out_paths], target, force=force, dry=dry
    )


def report(
    console: Console,
    gestures: list[Gesture],
    held_out: Gesture | None,
    takes: list[Path],
    output_path: Path | None,
    *,
    force: bool,
    dry: bool,
) -> Measured:
    """Fit a key to gestures, whose `takes` are already written; print and write the result.

    Raises Refused, and Findings if the model does not explain the key.
    """
    from ergon.workshop.metrology import stages
    from ergon.workshop.metrology.gesture import MeasurementError, sensor_step

    position_step = sensor_step(gestures if held_out is None else [*gestures, held_out])
    if not console.json:
        step_head = "" if position_step is None else f"{'of step':>9}"
        header = f"{'':14}{'fit rms':>10}{step_head}{'replay':>10}{step_head}{'BIC':>12}"
        console.data(f"{header}   what was added\n")
    try:
        measured = stages.measure(
            gestures, held_out, lambda stage: _print_stage(console, stage, position_step)
        )
    except MeasurementError as error:
        raise Refused(str(error)) from None
    _print_noise(console, measured, position_step)
    if output_path is not None:
        shown_gesture = gestures[-1] if held_out is None else held_out
        picture_text = _picture_text(measured, shown_gesture, output_path.stem)
        text_by_path = {
            output_path: _calibration_text(measured, takes),
            output_path.with_suffix(".svg"): picture_text,
        }
        write_texts(console, text_by_path, force=force, dry=dry)
    if measured.noise is not None and measured.fit.rms > _NOISE_RATIO_MAX * measured.noise:
        raise Findings(
            f"the model leaves {measured.fit.rms * 1e6:.3g} um where the sensor's noise is "
            f"{measured.noise * 1e6:.3g} um: {_cause(gestures)}"
        )
    return measured


def _cause(gestures: list[Gesture]) -> str:
    """Why the residual of a model is larger than the sensor's noise."""
    from ergon.workshop.metrology.gesture import LATE_SHARE_MAX

    n_positions = sum(gesture.is_compared.size for gesture in gestures)
    n_late_ticks = n_positions - sum(int(gesture.is_compared.sum()) for gesture in gestures)
    if n_late_ticks > LATE_SHARE_MAX * n_positions:
        return (
            f"{n_late_ticks:,} of {n_positions:,} positions were lost or came late; "
            "measure where the machine and the line keep time"
        )
    return "something acts on this key that the model lacks"


def gesture(console: Console, path: Path, hand: str | None, force_step: float) -> Gesture:
    """The gesture of a hand of a take, whose motor rounds forces to a step [N].

    Raises Refused if the take cannot be used for measuring.
    """
    from ergon.exchange.recording import read_description
    from ergon.workshop.metrology.gesture import MeasurementError, gesture_from_recording

    take = read(console, path)
    hand_names = take.names
    if hand is None and len(hand_names) > 1:
        raise Refused(
            f"{path}: this take has several hands ({', '.join(hand_names)}); choose by --hand"
        )
    if hand is not None and hand not in hand_names:
        raise Refused(f"{path}: there is no hand {hand!r}; the take has {', '.join(hand_names)}")
    is_of_wire = read_description(take).get("sent") == "wire"
    if not is_of_wire:
        console.say(f"{path}: an older take: its forces are those before the wire rounded them")
    hand_index = 0 if hand is None else hand_names.index(hand)
    try:
        return gesture_from_recording(
            take, hand_index, loses_requests=is_of_wire, force_step=force_step
        )
    except MeasurementError as error:
        raise Refused(f"{path}: {error}") from None


def _print_stage(console: Console, stage: Stage, position_step: float | None) -> None:
    """A row of the table; `position_step` [m] is the sensor's."""
    from ergon.workshop.metrology.mode_search import SCORE_MIN

    fit = stage.fit
    if console.json:
        console.record(
            "stage",
            name=stage.name,
            kept=stage.is_accepted,
            removal=stage.is_removal,
            rms_m=fit.rms,
            replay_m=stage.replay_rms,
            bic=fit.bic,
            score=stage.score,
            parameters=_fitted_values(stage),
        )
        return
    sign = "- " if stage.is_removal else "+ "
    stage_name = stage.name if stage.name == "M K Z" else sign + stage.name
    verdict = _added_part(stage)
    if stage.score is not None and not stage.is_accepted and stage.score < SCORE_MIN:
        verdict = f"none: the highest score is {stage.score:.0f} of {SCORE_MIN:.0f}"
    elif stage.is_removal:
        verdict = "taken away" if stage.is_accepted else "stays"
    elif not stage.is_accepted:
        verdict += ", not kept"
    fit_text, replay_text = (
        f"{rms * 1e6:7.4g} um" + ("" if position_step is None else f"{rms / position_step:9.3g}")
        for rms in (fit.rms, stage.replay_rms)
    )
    console.data(f"{stage_name:14}{fit_text}{replay_text}{fit.bic:12,.0f}   {verdict}\n")


def _fitted_values(stage: Stage) -> dict[str, dict[str, float]]:
    """The fitted values and their standard deviations, in SI units."""
    from ergon.workshop.metrology.parameters import parameter_name

    fit = stage.fit
    return {
        parameter_name(index): {
            "value": float(fit.parameters[index]),
            "deviation": fit.deviation(index),
        }
        for index in fit.fitted_indices
    }


def _added_part(stage: Stage) -> str:
    """What a stage added, in the units of a score."""
    from ergon.workshop.metrology.calibration_file import t60
    from ergon.workshop.metrology.parameters import INDEX, mode_indices, n_modes

    fitted_parameters = stage.fit.parameters
    figures = {name: float(fitted_parameters[index]) for name, index in INDEX.items()}
    match stage.name:
        case "M K Z":
            return (
                f"{figures['mass'] * 1e3:.4g} g, {figures['stiffness']:.4g} N/m, "
                f"{figures['damping']:.3g} Ns/m"
            )
        case "dry":
            return f"{figures['dry'] * 1e3:.4g} mN"
        case "presliding":
            return f"{figures['presliding']:.4g} N/m"
        case "Stribeck":
            return f"{figures['static_dry'] * 1e3:.4g} mN, {figures['static_speed'] * 1e3:.3g} mm/s"
        case "delay":
            return f"{figures['delay'] * 1e3:.4g} ms"
    if not n_modes(fitted_parameters):
        return "none"
    mode_mass, frequency, ratio = (
        float(fitted_parameters[index]) for index in mode_indices(n_modes(fitted_parameters) - 1)
    )
    return f"{mode_mass * 1e3:.3g} g at {frequency:.4g} Hz, t60 {t60(frequency, ratio):.3g} s"


def _print_noise(console: Console, measured: Measured, position_step: float | None) -> None:
    noise = measured.noise
    if console.json:
        console.record(
            "measured",
            rms_m=measured.fit.rms,
            replay_m=measured.replay_rms,
            noise_m=noise,
            step_m=position_step,
        )
        return
    step_text = "" if position_step is None else f"; its step is {position_step * 1e6:.3g} um"
    if noise is None:
        console.say(
            "no take begins with a still key for 50 ticks, so the sensor's noise is not known"
            + step_text
        )
    else:
        console.say(f"the sensor's noise is {noise * 1e6:.3g} um{step_text}")


def _picture_text(measured: Measured, gesture: Gesture, picture_title: str) -> str:
    """A picture of a gesture on the key, on the fitted model, and on the model of the first
    stage.
    """
    from ergon.workshop.metrology.comparison import replay
    from ergon.workshop.metrology.picture import picture

    fitted_replay = replay(measured.fit.parameters, gesture)
    first_replay = replay(measured.stages[0].fit.parameters, gesture)
    return picture(fitted_replay, picture_title, first_replay)


def _calibration_text(measured: Measured, takes: list[Path]) -> str:
    from datetime import date

    from ergon.workshop.metrology.calibration_file import text

    digests = [file_digest(take).hex() for take in takes]
    return text(measured, digests, date.today().isoformat())


def write_texts(
    console: Console, text_by_path: Mapping[Path, str], *, force: bool, dry: bool
) -> None:
    """Write text files, all or none, or only say that they would be written."""
    from ergon.exchange.safe import file_group

    if not dry:
        with file_group(force=force) as files:
            for path, content in text_by_path.items():
                files.write(path, content.encode())
    event_name = "would write" if dry else "wrote"
    for path in text_by_path:
        if console.json:
            console.record(event_name.replace(" ", "_"), file=str(path))
        else:
            console.say(f"{event_name} {path}")
