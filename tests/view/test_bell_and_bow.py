"""Two fingers on a page play a bell and a bow in a real browser."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from duets import command_output, recorded, sound
from hands_page import HandsPage
from patience import until
from scipy.integrate import ode

from ergon import _core
from ergon.api.play import PlayOptions, begin, prepare
from ergon.common.report import Report
from ergon.live.pointer_address import Finger

# The bow is a key of a viol, the bell is pressed by a contact; travels are those of the keys.
SCORE = """\
ergon: 1
use: [instruments/friction.yaml]
accuracy: {method: ca}
keys:
  bow: {M: 50g, K: 0.5N/m, Z: 1Ns/m, travel: -40mm..40mm}
  k: {M: 50g, K: 60N/m, Z: 1Ns/m, travel: -15mm..15mm}
instruments:
  gamba:
    from: friction/viol
    modules: {hair: {LNL: {between: [bow, body.8], damping: bow, F: 1N, a: 60}}}
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 2.5s}}
      b: {BUT: {between: [k, m], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
players: {ada: {hand: live, key: bow}, remi: {hand: live, key: k}}
parts: {}
mix:
  channels: 2
  route:
    - {from: gamba, to: 1, gain: 40dB}
    - {from: bell, to: 2, gain: 60dB, highpass: 20Hz}
render: {tail: 900s}
"""
KEYS = {"ada": (0.5, 0.04), "remi": (60.0, 0.015)}  # spring [N/m], half of the travel [m]
MASS, DAMPING = 0.05, 1.0
PULP = (2000.0, 2.0)
TICK = 44 / 44100  # [s]
TICK_FRAMES = 44
FADED = 1000  # frames at the end of a stopped performance
_STEP_MAX = 1 / 30  # of the path between two positions [s]


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as program:
        yield program


def rates(t: float, y: np.ndarray, *args: float) -> list[float]:
    """Speeds and accelerations of finger and key, while the pointer moves evenly."""
    start, speed, k, force, stiffness = args
    x, v, key, key_v = y
    pulp = PULP[0] * (x - key) + PULP[1] * (v - key_v)
    pull = k * (start + speed * t - x) + Finger().damping * (speed - v)
    single = force + pulp - DAMPING * key_v - stiffness * key
    return [v, (pull - pulp) / Finger().mass, key_v, single / MASS]


def reference(trace: np.ndarray, stiffness: float) -> np.ndarray:
    """Positions of the key by DOP853 for the same pointer and the same forces, tick by tick."""
    solver = ode(rates).set_integrator("dop853", rtol=1e-9, atol=1e-12)
    state, landed, key = np.zeros(4), None, []
    for start, end, firmness, force, _, _ in trace:
        if math.isnan(start):
            assert landed is None, "a finger that is lifted is not computed here"
            key.append(0.0)
            continue
        if landed is None:
            landed, offset, since = True, state[2] - start, 0.0
        left = [
            1.0 - min(s, 1.0) ** 2 * (3.0 - 2.0 * min(s, 1.0)) for s in (since, since + TICK / 0.1)
        ]
        start, end, since = start + offset * left[0], end + offset * left[1], since + TICK / 0.1
        speed, k = (end - start) / TICK, Finger().stiffness * firmness

        solver.set_f_params(start, speed, k, force, stiffness).set_initial_value(state)
        state = solver.integrate(TICK)
        assert solver.successful()
        key.append(state[2])
    return np.array(key)


# Fingers move by the clock of the machine, and how hard they press depends on how busy it is.
@pytest.mark.slow
@pytest.mark.parametrize("seconds", [4.0, 60.0])
def test_page_fingers_play_bell_and_bow(
    chromium: browser.Browser, work_folder: Path, seconds: float
):
    Path("s.yaml").write_text(SCORE)
    options = PlayOptions(
        live=[f"{player}=page:?trace={3 * seconds + 60:g}s" for player in KEYS],
        record="hand.take",
        audio="file:played.wav",
        gain="0dB",
    )
    ready = prepare("s.yaml", options, Report())
    performance = begin(ready.stage, ready.config, Report())
    events: list[str] = []
    leads = {board.axes[0][1]: board.pointer for board in ready.hands.boards}

    def has(event: str, times: int) -> bool:
        events.extend(what for _, what, _ in performance.events())
        return events.count(event) == times

    try:
        assert ready.config.pages is not None
        with chromium.page(420, 520) as page:
            hands = HandsPage(page, ready.config.pages.server.url)
            page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
            until(lambda: has("gone", 2), "stand-ins while no page plays")
            (x, y), (u, v) = hands.middle(0), hands.middle(1)
            hands.touch("touchStart", (1, x, y), (2, u, v))
            until(lambda: has("took over", 2), "hands from the next bar on")
            # Strokes of a bow to and fro, and two presses of the bell in a second.
            # On a busy machine the path slows down, and loses none of its points.
            t, last = 0.0, time.monotonic()
            while t < seconds:
                now = time.monotonic()
                t, last = t + min(now - last, _STEP_MAX), now
                stroke = 110.0 * math.sin(2 * math.pi * 0.7 * t)  # [px]
                press = 90.0 * max(0.0, math.sin(2 * math.pi * 2.0 * t))
                hands.touch("touchMove", (1, x, y - stroke), (2, u, v - press))
            assert has("gone", 2), "both fingers stayed on their keys"
            performance.stop()
            assert page.errors == []
    finally:
        performance.stop()
        performance.close(10.0)
        traces = {player: lead.trace() for player, lead in leads.items() if lead is not None}
        tallies = {player: lead.tally for player, lead in leads.items() if lead is not None}
        ready.close()

    take = recorded(Path("hand.take"))
    assert _matches(traces, take) == []
    for player, (stiffness, half) in KEYS.items():
        trace, tally = traces[player], tallies[player]
        assert tally["taken"] > 20
        assert tally["refused"] == 0
        key = trace[:, 5]
        assert np.max(np.abs(key)) < half, "no end is met, which the reference does not have"
        assert np.ptp(key) > 0.2 * half
        wanted = reference(trace, stiffness)
        error = np.sqrt(np.mean((key - wanted) ** 2) / np.mean(wanted**2))
        print(f"{player}: {len(trace)} ticks, {20 * math.log10(error):.1f} dB, {tally}")
        assert 20 * math.log10(error) < -60.0
    assert np.ptp(traces["remi"][:, 3]) > 0.1, "the bell pushed the finger [N]"

    played = sound(Path("played.wav"))[:-FADED]
    end = f"{len(take.positions()) * TICK_FRAMES / 44100:.3f}s"
    render = ("render", "s.yaml", "--hands", "hand.take", "--until", end, "--bits", "float")
    code, words = command_output(*render, "-o", "expected.wav")
    assert code == 0, words
    expected = sound(Path("expected.wav"))[: len(played)]
    assert np.all(np.max(np.abs(played), axis=0) > 1e-3), "bow and bell"
    assert np.array_equal(played, expected)


def _matches(traces: dict[str, np.ndarray], take: _core.Recording) -> list[str]:
    """Players whose traced key is not that of the take, where the hand had taken over."""
    wrong = []
    for column, player in enumerate(KEYS):
        positions = take.positions()[:, column]
        key = np.round(traces[player][:, 5], 12)
        n = 500  # the last ticks of the take
        window = np.round(positions[-n - 50 : -50], 12)
        ends = [i for i in range(len(key) - n + 1) if key[i] == window[0]]
        if not any(np.array_equal(key[i : i + n], window) for i in ends):
            wrong.append(player)
    return wrong
