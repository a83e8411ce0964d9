"""How short a tick a device and this machine bear, and what a shorter one costs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ergon import _core

from .fitness import Finding, duration_text, quantile

if TYPE_CHECKING:
    from ergon._core import Checkup

_AUDIO_RATE = 44100
# Frames in a tick: from the usual 1 kHz to one tick for each frame of the sound.
TICK_FRAMES = (44, 22, 11, 5, 2, 1)
_LATE_SHARE = 0.5  # a later tick or reply, as a share of the length, is late
_LATE_MAX = 1e-3  # largest share of late ticks and replies


def measure_tick_rates(url: str, test_seconds: float) -> Iterator[Finding]:
    """A finding for each length of a tick, each measured for `test_seconds` [s]; then one that
    advises.

    The device gets no force. Raises EngineError where it is not there.
    """
    best_finding = None
    for tick_frames in TICK_FRAMES:
        rate = _AUDIO_RATE / tick_frames
        device = _core.Device(url)
        try:
            cpu_start = time.process_time()
            checkup = device.checkup(test_seconds, 1.0 / rate)
            cpu_seconds = time.process_time() - cpu_start
        finally:
            device.close()
        finding = _tick_finding(url, rate, checkup, cpu_seconds)
        if finding.numbers["fits"]:
            best_finding = rate, finding
        yield finding
    yield _advice(url, best_finding)


def _tick_finding(url: str, rate: float, checkup: Checkup, cpu_seconds: float) -> Finding:
    """What ticks of `rate` [Hz] cost; `cpu_seconds` [s] is the processor's time for all of them."""
    tick_duration, round_trips = 1.0 / rate, checkup.round_trips()
    n_requests = len(round_trips) + checkup.unanswered
    n_late_wakes = int((checkup.lateness() > _LATE_SHARE * tick_duration).sum())
    n_slow_trips = int((round_trips > _LATE_SHARE * tick_duration).sum()) + checkup.unanswered
    load = cpu_seconds / checkup.seconds if checkup.seconds else 0.0
    median_delay, p99_delay = (
        tick_duration + quantile(round_trips, probability) for probability in (0.5, 0.99)
    )
    is_fit = n_requests > 0 and max(n_late_wakes, n_slow_trips) <= _LATE_MAX * n_requests
    tick_sentence = (
        f"{url}: {rate:,.0f} Hz: {duration_text(median_delay)} from a position to its force, p99 "
        f"{duration_text(p99_delay)}; {100 * load:.0f}% of a processor; {n_late_wakes:,} ticks and "
        f"{n_slow_trips:,} "
        f"replies late of {n_requests:,}"
    )
    tick_figures = {
        "url": url,
        "tick_hz": rate,
        "asked": n_requests,
        "late_ticks": n_late_wakes,
        "late_replies": n_slow_trips,
        "load": load,
        "felt_p50_s": median_delay,
        "felt_p99_s": p99_delay,
        "fits": is_fit,
    }
    return Finding("tick", tick_sentence, "", tick_figures)


def _advice(url: str, best_finding: tuple[float, Finding] | None) -> Finding:
    """The shortest tick of which at most one in a thousand is late."""
    if best_finding is None:
        finding_sentence = f"{url}: more than one tick in 1,000 is late with every length of a tick"
        advice = "close other programs, or try another cable or port; `tick: 500Hz` gives more time"
        return Finding("shortest", finding_sentence, advice, {"url": url, "tick_hz": None})
    rate, finding = best_finding
    finding_sentence = (
        f"{url}: `tick: {rate:.0f}Hz` of a player is the shortest that holds: a force comes "
        f"{duration_text(float(str(finding.numbers['felt_p50_s'])))} after its position, and takes "
        f"{100 * float(str(finding.numbers['load'])):.0f}% of a processor beside the piece"
    )
    return Finding("shortest", finding_sentence, "", {"url": url, "tick_hz": rate})
