"""`ergon doctor`: whether this machine is fit to play, and what to do if it is not."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .outcome import DeviceMissing, Findings, Refused

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ergon.live.fitness import Finding


@click.command()
@click.option("--no-audio", is_flag=True, help="Do not open the sound server.")
@click.option(
    "--audio",
    default="auto",
    show_default=True,
    metavar="WHERE",
    help="Where the sound would go, as for `ergon play`.",
)
@click.option(
    "--device",
    "devices",
    multiple=True,
    metavar="URL|NAME",
    help="Measure how soon this device replies; repeatable.",
)
@click.option(
    "--ticks",
    is_flag=True,
    help="With --device: how short a tick it bears, up to the audio rate, and what that costs.",
)
@click.option(
    "--hands",
    "hands",
    multiple=True,
    metavar="ADDRESS",
    help="Measure how positions arrive from this input, such as page: or midi:cc2; repeatable.",
)
@click.option(
    "--seconds",
    type=options.Number(0.1, 3600, "DURATION"),
    default=3.0,
    show_default=True,
    help="Seconds of each measurement.",
)
@click.option(
    "--safety",
    is_flag=True,
    help="Make faults on emulated devices instead, and say how soon the force ends.",
)
@options.with_console
def doctor(
    console: Console,
    no_audio: bool,
    audio: str,
    devices: tuple[str, ...],
    ticks: bool,
    hands: tuple[str, ...],
    seconds: float,
    safety: bool,
) -> None:
    """Measure whether this machine is fit to play.

    Measured are how fast it works beside the table of costs (kept for what `ergon plan` shows), the
    priority that the physics thread gets, how late it wakes, where the sound goes and its delay,
    and how soon devices reply. A line says what to do where a result is poor. No
    device gets a force.

    With --device and --ticks nothing else is measured but ticks of that device, from 1 kHz up to
    one for each frame of the sound at 44.1 kHz: how soon a force follows its position, how many
    ticks and replies are late, and what part of a processor they take.

    With --hands nothing else is measured: the inputs wait until you move them, and what comes
    during the measurement is counted: positions a second, jitter and time on the way.

    With --safety no machine is measured and no device opened: every fault is made on every emulated
    device, in virtual time. Exits 1 when a force lasts longer, is greater or grows faster than it
    may.
    """
    if safety:
        _measure_safety(console)
        return
    if hands:
        _measure_hands(console, hands, seconds)
        return
    if ticks and not devices:
        raise Refused("--ticks measures a device: name it by --device")
    if not ticks:
        for finding in _machine_findings(audio, no_audio, seconds):
            _print_finding(console, finding)
    missing_devices = []
    for url in _device_urls(devices):
        try:
            _measure_device(console, url, seconds, ticks)
        except DeviceMissing as error:
            missing_devices.append(error.message)
    if missing_devices:
        raise DeviceMissing("; ".join(missing_devices))


def _measure_safety(console: Console) -> None:
    from ergon.live import faults

    rows = faults.measure_faults()
    exceeding = []
    for table_row in rows:
        if not console.json:
            console.data(f"{table_row.fault}  (bound: {faults.bounds_text(table_row)})\n")
        for table_cell in table_row.results:
            if table_cell.exceeds:
                exceeding.append(f"{table_row.fault}, {table_cell.device}")
            if console.json:
                console.record("fault", fault=table_row.fault, **asdict(table_cell))
            else:
                mark = "  EXCEEDS ITS BOUND" if table_cell.exceeds else ""
                console.data(f"    {table_cell.device:9}  {table_cell.said}{mark}\n")
    if exceeding:
        raise Findings(
            "a force lasts longer, is greater or grows faster than its "
            f"bound: {'; '.join(exceeding)}"
        )


def _measure_hands(console: Console, addresses: tuple[str, ...], measured_seconds: float) -> None:
    from ergon.api.hand_checks import measure_hands

    findings = measure_hands(addresses, measured_seconds, console)
    for finding in findings:
        _print_finding(console, finding)
    if missing_inputs := [
        f"{finding.numbers['url']}: nothing came"
        for finding in findings
        if not finding.numbers["taken"]
    ]:
        raise DeviceMissing("; ".join(missing_inputs))


def _machine_findings(audio: str, no_audio: bool, test_seconds: float) -> Iterator[Finding]:
    from ergon import _core
    from ergon.exchange import machine_speed
    from ergon.live import fitness

    yield fitness.describe_machine()
    speed = fitness.measure_speed(min(test_seconds, 1.0))
    machine_speed.store_correction(float(str(speed.numbers["correction"])))
    yield speed
    yield fitness.describe_laws()
    checkup = _core.checkup(test_seconds, fitness.TICK_SECONDS)
    yield from fitness.describe_thread(checkup)
    yield fitness.measure_wakeups(checkup)
    if not no_audio:
        yield fitness.measure_sound(audio)


def _device_urls(devices: tuple[str, ...]) -> list[str]:
    from ergon.live.boards import BoardError, device_urls, url_and_axis

    try:
        url_by_name = device_urls() if devices else {}
        return [url_and_axis(text, url_by_name)[0] for text in devices]
    except BoardError as error:
        raise Refused(f"--device: {error}") from None


def _measure_device(console: Console, url: str, test_seconds: float, ticks: bool) -> None:
    from ergon import _core
    from ergon.live import fitness, tick_rates

    measure = tick_rates.measure_tick_rates if ticks else fitness.measure_device
    try:
        for finding in measure(url, test_seconds):
            _print_finding(console, finding)
    except _core.EngineError as error:
        raise DeviceMissing(str(error)) from None


def _print_finding(console: Console, finding: Finding) -> None:
    if console.json:
        console.record(finding.topic, **finding.numbers, said=finding.sentence, todo=finding.advice)
        return
    console.data(f"{finding.topic:8} {finding.sentence}\n")
    if finding.advice:
        console.data(f"{'':8} -> {finding.advice}\n")
