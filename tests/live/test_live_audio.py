"""What is pushed to a card is what comes out of it: files, clocks, and servers that die.

The servers run without a sound card. What is heard there is captured by a second client.
"""

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from captured import compare
from patience import PATIENCE, until
from servers import Jack, Pulse, jack_name

from ergon import _core
from ergon.exchange import wave_header

RATE = 48000


def noise(n_frames: int, n_channels: int, seed: int = 1) -> np.ndarray:
    """Frames no two of which are alike, with a silent second before them: time to plug in."""
    sound = np.random.default_rng(seed).random((n_frames, n_channels), dtype=np.float32) - 0.5
    return np.concatenate([np.zeros((RATE // 2, n_channels), np.float32), sound])


@pytest.fixture(scope="module")
def name() -> Iterator[str]:
    with jack_name() as name:
        yield name


@pytest.fixture(autouse=True)
def no_server(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test hears a server that is not its own."""
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    monkeypatch.setenv("PULSE_SERVER", f"unix:{tmp_path}/pulse.sock")
    monkeypatch.delenv("JACK_NO_AUTOCONNECT", raising=False)


@pytest.fixture
def jack(name: str) -> Iterator[Jack]:
    server = Jack(name)
    with server.run():
        yield server


# --- files and clocks -----------------------------------------------------------------------------


@pytest.mark.parametrize("n_channels", [1, 2, 24, 64])
def test_file_output_contains_pushed_frames(tmp_path: Path, n_channels: int):
    sound = noise(5000, n_channels)
    path = tmp_path / "a, b=c.wav"
    text = _core.play_frames(sound, 44100, f"file:{path}")
    assert str(path) in text
    data = path.read_bytes()
    head = wave_header.pack(
        wave_header.WaveFormat(44100, n_channels, "float"), len(sound), wave_header.Stamp("")
    )
    assert data == head + sound.tobytes()
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


def test_file_output_renamed_when_complete(tmp_path: Path):
    path = tmp_path / "a.wav"
    out = _core.AudioOut(f"file:{path}", RATE, 2)
    out.play(noise(RATE * 6, 2))
    assert not path.exists()
    (part,) = tmp_path.iterdir()
    with part.open("rb") as file:
        until(lambda: file.seek(0) == 0 and wave_header.parse(file).n_frames > 0, "a header")
    out.close()
    assert path.exists()
    assert not part.exists()
    with pytest.raises(_core.EngineError, match="exist"):
        _core.AudioOut(f"file:{path}", RATE, 2)
    with pytest.raises(_core.EngineError, match=str(tmp_path)):
        _core.AudioOut(f"file:{tmp_path}/nowhere/a.wav", RATE, 2)


def test_file_output_on_full_disk(tmp_path: Path):
    path = tmp_path / "a.wav"
    code = f"""
import resource, numpy as np
from ergon import _core
resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))
out = _core.AudioOut("file:{path}", 48000, 2)
try:
    out.play(np.ones((200_000, 2), np.float32))
    assert out.finish({PATIENCE}), "the performance goes on"
    assert not out.alive
    print(out.events[0].sentence)
    out.close()
except _core.EngineError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    event, error = done.stdout.splitlines()
    assert "plays on in silence" in event
    assert "could not be written" in error
    (part,) = tmp_path.iterdir()
    assert str(part) in error
    assert part.stat().st_size == 2**20


def test_null_output_paced_by_clock():
    out = _core.AudioOut("null,block=64", RATE, 2)
    began = time.monotonic()
    out.play(noise(RATE // 4, 2))
    assert out.finish(PATIENCE)
    # Not sooner than they last; how much later is the machine's affair.
    assert time.monotonic() - began >= 0.7
    assert out.info.block == 64
    out.close()
    assert not out.alive


def test_null_fast_output_without_losses():
    out = _core.AudioOut("null:fast", RATE, 2, capacity=300)
    out.play(noise(100_000, 2))
    assert out.finish(PATIENCE)
    assert (out.played, out.underruns) == (124_000, 0)


def test_auto_output_description_of_choice():
    out = _core.AudioOut("auto", RATE, 2)
    backend, sentence = out.info.backend, out.info.sentence
    assert backend == "null"
    assert "no JACK server" in sentence or "no JACK library" in sentence
    assert "PulseAudio" in sentence
    assert [system.name for system in _core.survey_audio()] == ["jack", "pulse", "null", "file"]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("alsa", "no such output"),
        ("file:", "path"),
        ("jack,block=none", "block=none"),
        ("jack", "JACK"),
        ("pulse", "PulseAudio"),
    ],
)
def test_missing_audio_outputs_are_refused(spec: str, words: str):
    with pytest.raises(_core.EngineError, match=words):
        _core.AudioOut(spec, RATE, 2)


def test_pulse_refuses_33_channels():
    with pytest.raises(_core.EngineError, match=r"33 channels.*32.*jack"):
        _core.AudioOut("pulse", RATE, 33)


# --- JACK -----------------------------------------------------------------------------------------


@contextlib.contextmanager
def captured(sound: np.ndarray, spec: str = "jack") -> Iterator[_core.AudioOut]:
    """Play, and assert that a second client hears every sample, unless the machine was late."""
    n_frames, n_channels = sound.shape
    capture = _core.JackCapture("capture", n_channels, n_frames + 20 * RATE)
    out = _core.AudioOut(spec, RATE, n_channels, capacity=16384)
    assert capture.connect("ergon", 5.0)
    out.play(sound)
    yield out
    assert out.finish(PATIENCE)
    out.close()
    # A late machine says so. Underruns fade, so that samples beside a gap differ.
    if not (out.xruns or out.underruns or out.events):
        result = compare(capture.finish(), sound)
        assert result.exact, result


def test_jack_output_bits_equal_pushed_frames(jack: Jack):
    with captured(noise(RATE, jack.channels)) as out:
        info = out.info
        assert (info.backend, info.rate, info.block) == ("jack", RATE, jack.block)
        assert "ergon" in info.device
        assert "system:playback_1" in info.device
        assert info.latency > 0
        assert "24 channels at 48000 Hz" in info.sentence
        assert out.alive


def test_jack_output_bits_equal_in_freewheel(jack: Jack):
    sound = noise(10 * RATE, jack.channels)
    capture = _core.JackCapture("capture", jack.channels, len(sound) + 60 * RATE)
    out = _core.AudioOut("jack", RATE, jack.channels, capacity=16384)
    assert capture.connect("ergon", 5.0)
    assert capture.freewheel(True)
    until(lambda: out.freewheeling, "freewheeling")
    out.play(sound)
    assert out.finish(PATIENCE)
    assert capture.freewheel(False)
    until(lambda: not out.freewheeling, "the clock again")
    out.close()
    # Here the callback waits for the physics: nothing may be missing, however slow the machine.
    result = compare(capture.finish(), sound)
    assert result.exact, result
    assert out.underruns == 0


def test_jack_underrun_counted_and_faded(jack: Jack):
    capture = _core.JackCapture("capture", 1, 20 * RATE)
    out = _core.AudioOut("jack", RATE, 1, capacity=16384)
    assert capture.connect("ergon", 5.0)
    out.play(np.ones((RATE // 2, 1), np.float32))
    until(lambda: out.underruns == 1, "an underrun")
    out.play(np.ones((RATE // 2, 1), np.float32))
    out.panic()
    until(lambda: out.discarded > 0, "silence")
    out.close()
    listened = capture.finish()[:, 0]
    begun = listened[np.flatnonzero(listened)[0] :]
    assert out.missing > 0
    if out.xruns == 0:
        # Down and up by 2 ms ramps, to silence by one of 5 ms: never a jump.
        assert np.abs(np.diff(begun)).max() <= 1 / 96 + 1 / 240 + 1e-6
    assert begun[-1] == 0


def test_jack_at_another_rate_converts_and_says_so(jack: Jack):
    out = _core.AudioOut("jack", 44100, 2)
    assert out.info.rate == RATE
    assert "converted from 44100 Hz" in out.info.sentence
    out.play(np.zeros((22050, 2), np.float32))
    assert out.finish(PATIENCE)
    assert out.played == 22050


def test_jack_connection_options(jack: Jack, monkeypatch: pytest.MonkeyPatch):
    assert "not connected" in _core.AudioOut("jack:none", RATE, 2).info.device
    assert "system:playback_3" in _core.AudioOut("jack:playback_[34]$", RATE, 2).info.device
    assert "first 24 channels" in _core.AudioOut("jack", RATE, 30).info.sentence
    monkeypatch.setenv("JACK_NO_AUTOCONNECT", "1")
    assert "not connected" in _core.AudioOut("jack", RATE, 2).info.device


def test_auto_output_uses_running_jack(jack: Jack):
    assert _core.AudioOut("auto", RATE, 2).info.backend == "jack"
    assert _core.survey_audio()[0].sentence.startswith("a server at 48000 Hz")


def playing_until(out: _core.AudioOut, true, what: str) -> None:
    """Push without end, as a performance does, until something is so."""
    sound = noise(RATE // 10, 2)

    def so() -> bool:
        out.push(sound)
        return true()

    until(so, what)


def test_jack_output_reconnects_after_server_restart(name: str):
    server = Jack(name)
    with server.run() as process:
        out = _core.AudioOut("auto", RATE, 2)
        playing_until(out, lambda: out.played > RATE // 10, "sound")
        process.kill()
    playing_until(out, lambda: not out.alive, "the loss")
    lost = out.played
    # The performance goes on by the clock, unheard.
    playing_until(out, lambda: out.played > lost + RATE // 2, "going on")
    with server.run():
        playing_until(out, lambda: out.alive, "the return")
        back = out.played
        playing_until(out, lambda: out.played > back + RATE // 10, "sound again")
        single, two = out.events
        first, frame, second = single.sentence, two.frame, two.sentence
        assert "lost" in first
        assert "back" in second
        assert lost <= frame <= out.played
        out.close()


# --- PulseAudio -----------------------------------------------------------------------------------


def test_pulse_output_bits_equal_pushed_frames(tmp_path: Path):
    server = Pulse(tmp_path)
    sound = noise(RATE, server.channels)
    path = tmp_path / "heard.f32"
    with server.run():
        with server.recording(path):
            out = _core.AudioOut("pulse:dome", RATE, server.channels, capacity=16384)
            info = out.info
            assert (info.backend, info.device, info.rate) == ("pulse", "Null Output", RATE)
            out.play(sound)
            assert out.finish(PATIENCE)
            # parec hands on what it has, in order: a second of what comes after is behind it all.
            size = path.stat().st_size + 4 * RATE * server.channels
            until(lambda: path.stat().st_size >= size, "what comes after")
        out.close()
    listened = np.fromfile(path, np.float32)
    listened = listened[: len(listened) // server.channels * server.channels]
    if not (out.xruns or out.underruns):
        result = compare(listened.reshape(-1, server.channels), sound)
        assert result.exact, result


def test_pulse_converts_to_the_rate_of_its_sink(tmp_path: Path):
    with Pulse(tmp_path, rate=44100, channels=2).run():
        out = _core.AudioOut("pulse", RATE, 2)
        assert out.info.rate == 44100
        assert "converted from 48000 Hz" in out.info.sentence
        with pytest.raises(_core.EngineError, match="no sink nowhere"):
            _core.AudioOut("pulse:nowhere", RATE, 2)
        assert "dome (2 channels, 44100 Hz, default)" in _core.survey_audio()[1].sentence


def test_pulse_output_reconnects_after_server_restart(tmp_path: Path):
    server = Pulse(tmp_path, channels=2)
    with server.run() as process:
        out = _core.AudioOut("pulse", RATE, 2)
        playing_until(out, lambda: out.played > RATE // 10, "sound")
        process.kill()
    playing_until(out, lambda: not out.alive, "the loss")
    with server.run():
        playing_until(out, lambda: out.alive, "the return")
        assert ["lost" in event.sentence for event in out.events] == [True, False]
        out.close()
