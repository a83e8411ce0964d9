"""Measurements of whether this machine is fit to play, each with what to do about it."""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from ergon import _core
from ergon.common.compiler import load_numba

from .ports import latency_timer

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Checkup

# A tick of 44 frames at 44.1 kHz [s].
TICK_SECONDS = 44 / 44100
# A position that is read in one tick gives the force of the next: one tick, whatever the
# connection.
STRUCTURAL_TICKS = 1
# Frames computed ahead of the sound card.
FRAMES_AHEAD = 1024
_LATE_SHARE = 0.5  # a tick that begins later than this share of its length is late
_LATE_TICKS_MAX = 1e-3  # largest share of late ticks
_RIGHTS_ADVICE = (
    "put `@audio - rtprio 95` and `@audio - memlock unlimited` into "
    "/etc/security/limits.d/95-ergon.conf, join the group audio, and log in again"
)


@dataclass(frozen=True, slots=True)
class Finding:
    """A measurement in words and numbers, and advice: `advice` is empty if nothing is wrong."""

    topic: str
    sentence: str
    advice: str = ""
    numbers: Mapping[str, object] = field(default_factory=dict)


def describe_machine() -> Finding:
    """Kernel and processors."""
    cpu_count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    system = f"{platform.system()} {platform.release()}"
    advice = ""
    if (cpu_count or 1) < 2:
        advice = "physics and sound share one processor: expect gaps, and play with --ahead 4096"
    numbers = {"system": platform.system(), "kernel": platform.release(), "cpus": cpu_count}
    return Finding("machine", f"{system}, {cpu_count} CPUs", advice, numbers)


def describe_laws() -> Finding:
    """Whether laws that are computed often are compiled to machine code."""
    numba, missing_reason = load_numba()
    if numba is None:
        advice = "`pip install numba` where scores of a hundred laws are slow; all else is the same"
        return Finding("laws", f"computed step by step: {missing_reason}", advice, {"numba": None})
    version = str(numba.__version__)
    law_text = f"compiled by numba {version} where that is faster"
    return Finding("laws", law_text, numbers={"numba": version})


def measure_speed(test_seconds: float) -> Finding:
    """The time that work takes on this machine over that in the table of costs; runs for about
    `test_seconds`.
    """
    ratios = [_cost_ratio(*work, test_seconds / 3.0) for work in _speed_tests()]
    correction = math.prod(ratios) ** (1.0 / len(ratios))
    speed_text = f"work takes {correction:.2g} times as long as the table of costs says"
    if max(ratios) > 2.0 * min(ratios):
        speed_text += f" ({min(ratios):.2g} to {max(ratios):.2g})"
    return Finding("speed", speed_text, numbers={"correction": correction, "each": ratios})


def _speed_tests() -> Iterator[tuple[_core.Network, range, Literal["ca", "modal"]]]:
    """(network, MATs to strike, method), each with one kind of work."""
    bank_network = _core.Network()
    bank_network.part("bank")
    first_mat = bank_network.bank("b", count=2000, M=1e-3, f=(100.0, 8000.0), t60=(100.0, 100.0))
    bank_network.listen("x", positions=[(first_mat, 2000, 1.0)])
    yield bank_network, range(first_mat, first_mat + 2000), "modal"
    for masses in (2, 400):  # one frame has its own cost, whatever is in it
        string_network = _core.Network()
        string_network.part("string")
        string_mat = string_network.string("s", masses=masses, M=8e-3, f=20.0, t60=100.0)
        string_network.listen("x", positions=[(string_mat, 1, 1.0)])
        yield string_network, range(string_mat, string_mat + 1), "ca"


def _cost_ratio(
    network: _core.Network, struck_mats: range, method: Literal["ca", "modal"], test_seconds: float
) -> float:
    """The measured time of a network's work over that of the table of costs: the least of several
    blocks.
    """
    import numpy as np

    rate = 44100.0
    timeline = _core.Timeline(network, rate)
    for mat in struck_mats:
        timeline.strike(mat, 0.0, impulse=1e-3)
    plan = _core.Plan(network, timeline, method=method)
    cost = sum(row.cost for row in plan.rows()) / rate
    simulation = _core.Simulation(network, timeline, plan=plan)
    frame_block = np.empty((max(64, min(20_000, round(1e-2 / cost))), simulation.n_out))
    best_time = math.inf
    end_time = time.perf_counter() + test_seconds
    while best_time == math.inf or time.perf_counter() < end_time:
        start_time = time.thread_time()
        simulation.process(frame_block)
        best_time = min(best_time, time.thread_time() - start_time)
    return best_time / (len(frame_block) * cost)


def describe_thread(checkup: Checkup) -> Iterator[Finding]:
    """The priority and rights of the physics thread, as the kernel reports them."""
    if checkup.priority is None:
        finding_sentence, advice = "no real-time priority", _RIGHTS_ADVICE
        if platform.system() != "Linux":
            advice = (
                "this system gives none; keep other programs closed, and play with --ahead 4096"
            )
    else:
        finding_sentence, advice = f"SCHED_FIFO {checkup.priority}", ""
    yield Finding("thread", finding_sentence, advice, {"fifo": checkup.priority})
    finding_sentence = "locked in RAM" if checkup.locked else "not locked: it may be swapped out"
    yield Finding(
        "memory",
        finding_sentence,
        "" if checkup.locked else _RIGHTS_ADVICE,
        {"locked": checkup.locked},
    )


def measure_wakeups(checkup: Checkup, noun: str = "wake-up") -> Finding:
    """The lateness of a thread that sleeps from tick to tick."""
    lateness = checkup.lateness()
    n_late_ticks = int((lateness > _LATE_SHARE * TICK_SECONDS).sum())
    wakeup_sentence = (
        f"{quantiles_text(lateness)}; {n_late_ticks:,} of {len(lateness):,} ticks late"
    )
    advice = ""
    if n_late_ticks > _LATE_TICKS_MAX * len(lateness):
        advice = (
            "the machine is too busy: close other programs, set the processor's governor to "
            "performance, and keep more ready for the card (--ahead 4096)"
        )
    numbers = {"ticks": len(lateness), "late_ticks": n_late_ticks, **histogram(lateness)}
    return Finding(noun, wakeup_sentence, advice, numbers)


def measure_sound(output_spec: str) -> Finding:
    """The audio server and its latency."""
    import numpy as np

    rate = 44100
    try:
        audio_out = _core.AudioOut(output_spec, rate, 2)
        audio_out.set_prefill(FRAMES_AHEAD)
        audio_out.play(np.zeros((rate // 2, 2), dtype=np.float32))
        audio_out.finish(5.0)
        stream = audio_out.info
        underruns = audio_out.underruns
        audio_out.close()
    except _core.EngineError as error:
        advice = (
            "start PipeWire, PulseAudio or JACK; without one `--audio file:x.wav` keeps the sound"
        )
        return Finding("sound", str(error), advice, {"backend": None})
    total_latency = FRAMES_AHEAD / rate + stream.latency
    sound_sentence = f"{stream.sentence}; heard {1e3 * total_latency:.0f} ms after it is computed"
    advice = ""
    if stream.backend == "null":
        advice = "no server answers: start PipeWire, PulseAudio or JACK to hear anything"
    elif underruns:
        advice = "half a second of silence had gaps: ask for a larger --block, or --ahead 4096"
    elif stream.block > 1024:
        advice = "the server takes large blocks: --block 256 asks for smaller ones"
    sound_figures: dict[str, object] = {
        "backend": stream.backend,
        "device": stream.device,
        "rate_hz": stream.rate,
        "block": stream.block,
        "latency_s": stream.latency,
        "total_s": total_latency,
        "gaps": underruns,
    }
    return Finding("sound", sound_sentence, advice, sound_figures)


def measure_device(url: str, test_seconds: float) -> list[Finding]:
    """The response time of a device. Raises EngineError if the device does not answer."""
    device = _core.Device(url)
    try:
        checkup, lockstep = device.checkup(test_seconds, TICK_SECONDS), device.lockstep
    finally:
        device.close()
    round_trips = checkup.round_trips()
    n_requests = len(round_trips) + checkup.unanswered
    device_sentence = (
        f"{quantiles_text(round_trips)}; {checkup.unanswered:,} of {n_requests:,} unanswered"
    )
    advice = []
    timer_ms = latency_timer(url)
    if timer_ms is not None and timer_ms > 1:
        port = os.path.basename(os.path.realpath(url.partition(":")[2].partition("?")[0]))
        advice.append(
            f"its FTDI chip holds bytes back for {timer_ms} ms: "
            f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{port}/latency_timer"
        )
    if checkup.unanswered > _LATE_TICKS_MAX * n_requests:
        advice.append("replies are lost: try another cable or port, without a hub")
    p99_trip = quantile(round_trips, 0.99)
    if not lockstep and p99_trip > _LATE_SHARE * TICK_SECONDS:
        advice.append("it needs most of a tick; `tick: 500Hz` in a score gives it more time")
    device_figures: dict[str, object] = {
        "url": url,
        "asked": n_requests,
        "unanswered": checkup.unanswered,
        "garbage": checkup.garbage,
        "drift_ppm": checkup.drift_ppm,
        "latency_timer_ms": timer_ms,
        "per_second": n_requests / checkup.seconds if checkup.seconds else None,
        **histogram(round_trips),
    }
    return [
        Finding("device", f"{url}: {device_sentence}", "; ".join(advice), device_figures),
        _force_delay(url, round_trips, lockstep=lockstep),
    ]


def _force_delay(url: str, round_trips: NDArray[np.float64], *, lockstep: bool) -> Finding:
    """The delay from the position of a hand to the force that answers it."""
    structural_delay = STRUCTURAL_TICKS * TICK_SECONDS
    median_delay, p99_delay = (
        structural_delay + quantile(round_trips, probability) for probability in (0.5, 0.99)
    )
    delay_text = "in emulated time (lockstep)" if lockstep else f"p99 {duration_text(p99_delay)}"
    delay_sentence = (
        f"{url}: {duration_text(median_delay)} from a position to its force, which is "
        f"{STRUCTURAL_TICKS} "
        f"tick of {duration_text(TICK_SECONDS)} and a round trip of "
        f"{duration_text(median_delay - structural_delay)}; {delay_text}"
    )
    delay_figures: dict[str, object] = {
        "url": url,
        "structural_ticks": STRUCTURAL_TICKS,
        "tick_s": TICK_SECONDS,
        "felt_p50_s": median_delay,
        "felt_p99_s": p99_delay,
    }
    return Finding("felt", delay_sentence, "", delay_figures)


# --- durations ------------------------------------------------------------------------------------


def quantile(durations: NDArray[np.float64], probability: float) -> float:
    """The quantile `probability` of durations [s]; NaN where there are none."""
    import numpy as np

    if not len(durations):
        return float("nan")
    return float(np.quantile(durations, probability, method="higher"))


def quantiles_text(durations: NDArray[np.float64]) -> str:
    """Median, 99 %, 99.9 % and the longest, in words."""
    if not len(durations):
        return "nothing to measure"
    quantiles = (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("longest", 1.0))
    return ", ".join(
        f"{name} {duration_text(quantile(durations, probability))}"
        for name, probability in quantiles
    )


def histogram(durations: NDArray[np.float64]) -> dict[str, object]:
    """The quantiles [s], and a histogram: bin i counts durations from 2^(i-1) µs to below 2^i µs.

    The first bin counts those below 1 µs; the last bin also counts all longer ones.
    """
    import numpy as np

    bin_counts = np.zeros(24, dtype=int)
    microseconds = np.maximum(np.floor(1e6 * durations + 1e-6), 0.0).astype(int)
    bin_indices = np.array([int(duration).bit_length() for duration in microseconds], dtype=int)
    np.add.at(bin_counts, np.minimum(bin_indices, len(bin_counts) - 1), 1)
    probabilities = (("p50_s", 0.5), ("p99_s", 0.99), ("p999_s", 0.999), ("max_s", 1.0))
    quantiles: dict[str, object] = {
        name: quantile(durations, probability) for name, probability in probabilities
    }
    return {**quantiles, "histogram_us": bin_counts.tolist()}


def duration_text(seconds: float) -> str:
    """A duration in µs below 1 ms, else in ms."""
    if seconds < 1e-3:
        return f"{1e6 * seconds:.0f} µs"
    return f"{1e3 * seconds:.2f} ms"
