"""The proof of playing: a key in another process, a sound server, and a second client that hears.

What is captured is what `ergon render` makes of the recording of the hands, sample for sample. In
lockstep the key waits for the piece, so only the server has a clock: what it drops shows as a gap,
which is told apart from a wrong sample.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from captured import Comparison, compare
from duets import duet, recorded, rendered
from emulators import emulator
from patience import until
from servers import Jack, Pulse, jack_name

from ergon import _core

RATE, CHANNELS = 48000, 24
# Sound begins when every client had time to plug in, and the host's force is all there (2 s).
GESTURE = "0mm@0 hold 0mm@3 smooth 9mm@3.2 0mm@3.4 hold 0mm@3.6 smooth 9mm@3.8 0mm@4.2"
TUNES = "\n".join(
    f"  bell{i}:\n"
    f"    modules: {{m: {{CEL: {{M: 2g, f: {180 + 37 * i}Hz, t60: 1.5s}}}}, "
    f"b: {{BUT: {{between: [{'kv'[i % 2]}, m], K: 40N/m, gap: {1 + i % 3}mm}}}}}}\n"
    f"    out: {{SOX: m}}"
    for i in range(1, CHANNELS + 1)
)
ROUTES = "\n".join(f"    - {{from: bell{i}, to: [{i}]}}" for i in range(1, CHANNELS + 1))
SCORE = f"""\
ergon: 1
rates: {{audio: {RATE}Hz}}
accuracy: {{method: ca}}
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}, v: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
instruments:
{TUNES}
gestures: {{knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}}
players: {{ada: {{key: v}}, remi: {{hand: live, key: k}}}}
parts: {{ada: [{{at: 1|4, play: knock, every: 1/2, times: 4}}]}}
mix:
  channels: {CHANNELS}
  route:
{ROUTES}
render: {{tail: 500ms}}
"""


@pytest.fixture(scope="module")
def name() -> Iterator[str]:
    with jack_name() as name:
        yield name


@pytest.fixture
def score(tmp_path: Path) -> Path:
    path = tmp_path / "proof.yaml"
    path.write_text(SCORE)
    return path


def key() -> list[str]:
    return ["firefader", "--lockstep", "--rate", "1000Hz", "--gesture", GESTURE, "--hand", "900N/m"]


def judged(listened: np.ndarray, score: Path, take: Path, lines: list[str]) -> Comparison:
    """What was heard beside what the recording renders to; that something was played at all."""
    forces = recorded(take)
    assert np.ptp(forces.positions()) > 8e-3
    assert forces.forces().min() < -0.3
    expected = rendered(score, take)
    assert (np.abs(expected).max(axis=0) > 1e-4).all(), "every loudspeaker sounds"
    result = compare(listened, expected)
    # Underruns fade, so that samples beside a gap differ; without a clock there is none (below).
    if "gaps" not in lines[-1]:
        assert result.wrong == 0, (result, lines)
        assert result.equal > RATE, (result, lines)
    return result


def test_duet_captured_by_jack_equals_render(
    name: str, score: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    take = tmp_path / "hand.take"
    with Jack(name, RATE, channels=CHANNELS).run(), emulator(*key()) as device:
        capture = _core.JackCapture("capture", CHANNELS, 60 * RATE)
        live = ("--live", f"remi={device.url}", "--record", take, "--gain", "60dB")
        with duet(score, *live, "--audio", "jack:capture:") as playing:
            assert "24 channels" in playing.until("jack (")
            assert playing.end() == 0, playing.lines
        result = judged(capture.finish(), score, take, playing.lines)
        # The server's own late cycles are no fault of the physics; they are gaps, and said.
        print(f"{result.equal} frames of {CHANNELS} channels equal, gaps: {result.gaps}")


@pytest.mark.slow
def test_unpaced_duet_captures_every_frame(
    name: str, score: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    take = tmp_path / "hand.take"
    with Jack(name, RATE, channels=CHANNELS).run(), emulator(*key()) as device:
        capture = _core.JackCapture("capture", CHANNELS, 120 * RATE)
        live = ("--live", f"remi={device.url}", "--record", take, "--gain", "60dB")
        with duet(score, *live, "--audio", "jack:capture:") as playing:
            playing.until("jack (")
            assert capture.freewheel(True)
            assert playing.end() == 0, playing.lines
        assert capture.freewheel(False)
        result = judged(capture.finish(), score, take, playing.lines)
        assert result.exact, result
    assert "gaps" not in playing.lines[-1]


@pytest.mark.slow
def test_duet_captured_by_pulse_equals_render(
    score: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("PULSE_SERVER", f"unix:{tmp_path}/pulse.sock")
    take, listened = tmp_path / "hand.take", tmp_path / "heard.f32"
    server = Pulse(tmp_path, RATE, CHANNELS)
    with server.run(), emulator(*key()) as device, server.recording(listened):
        live = ("--live", f"remi={device.url}", "--record", take, "--gain", "60dB")
        with duet(score, *live, "--audio", "pulse:dome") as playing:
            assert playing.end() == 0, playing.lines
        length = len(rendered(score, take)) * CHANNELS * 4
        until(lambda: listened.stat().st_size > length, "parec to hand on what it has")
    frames = np.fromfile(listened, np.float32)
    frames = frames[: len(frames) // CHANNELS * CHANNELS].reshape(-1, CHANNELS)
    result = judged(frames, score, take, playing.lines)
    print(f"{result.equal} frames of {CHANNELS} channels equal, gaps: {result.gaps}")
