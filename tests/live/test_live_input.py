"""A sound card excites an instrument: what is heard, what is recorded, and what is rendered.

The servers run without a sound card; what comes in is what another client plays.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile
from captured import Comparison, compare
from numpy.typing import NDArray
from patience import PATIENCE, until
from servers import Jack, Pulse, jack_name

from ergon import _core
from ergon.api.errors import OptionError
from ergon.api.options import PlayOptions, RenderOptions
from ergon.api.play import begin, prepare
from ergon.api.render import render
from ergon.common.report import Report

RATE = 48_000
TRIES = 20  # on a busy machine PulseAudio itself drops and repeats frames, and tells nobody
SCORE = """\
ergon: 1
rates: {audio: 48kHz}
takes: {mic: {input: 1, gain: 2mN, highpass: 20Hz, clamp: 1mN, file: rehearsal.wav}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}
      n: {CEL: {M: 1g, f: 587Hz, t60: 0.3s}}
      l: {REF: {between: [m, n], K: 40N/m, Z: 0.01Ns/m}}
      breath: {ENF: {to: m, from: mic}}
    out: {SOX: m}
mix: {route: [{from: bell, to: 1, gain: 80dB}]}
render: {tail: 3s}
"""


@pytest.fixture(scope="module")
def name() -> Iterator[str]:
    with jack_name() as name:
        yield name


@pytest.fixture(autouse=True)
def alone(name: str, work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test hears a server that is not its own; the score stands in a folder of its own."""
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    monkeypatch.setenv("PULSE_SERVER", f"unix:{work_folder}/pulse.sock")
    monkeypatch.delenv("JACK_NO_AUTOCONNECT", raising=False)
    Path("s.yaml").write_text(SCORE)
    soundfile.write("rehearsal.wav", noise(RATE // 2), RATE, subtype="FLOAT")


def noise(n_frames: int, seed: int = 1) -> NDArray[np.float32]:
    """Frames no two of which are alike."""
    return np.random.default_rng(seed).random(n_frames, dtype=np.float32) - 0.5


def playing(frames: Callable[[], object], **options: str | None) -> _core.SoundInput:
    """Play the score to its end while `frames` are played into it; what was heard.

    What it sounds like from its first ticks on is in `sound.wav`, and the frame in `first`.
    """
    ready = prepare("s.yaml", PlayOptions(**options), Report())  # type: ignore[arg-type]
    performance = begin(ready.stage, ready.config, Report())
    performance.record_audio(Path("sound.wav"))
    # A tenth of a second later the input is heard too.
    until(lambda: performance.status().played > RATE // 10, "sound")
    frames()
    until(lambda: performance.wait(0.1), "the end of the piece")
    listened, written = performance.sound_input(), performance.audio_recorded()
    assert written is not None
    assert written.first is not None
    Path("first").write_text(str(written.first))
    performance.close(PATIENCE)
    return listened


def rendered(input_file: str) -> NDArray[np.float32]:
    done = render("s.yaml", RenderOptions(input=input_file, bits="float"))
    return done.frames[:, 0].astype(np.float32)


def samples(path: str) -> NDArray[np.float32]:
    return soundfile.read(path, dtype="float32")[0]


# --- without a card ---


def test_live_input_without_card_plays_file():
    listened = playing(lambda: None, audio="null:fast", record_input="in.wav")
    assert not listened.live
    assert "no input (null has no inputs): each input of the score plays" in listened.sentence
    assert listened.recorded is None
    assert not Path("in.wav").exists()
    sounds_as("rehearsal.wav")


@pytest.mark.parametrize(
    ("where", "audio", "words"),
    [
        ("jack", "null", "JACK"),
        ("pulse", "null", "PulseAudio"),
        ("jack", "null:fast", "and the output does not take it so"),
        ("file:x.wav", "null", "use jack or pulse"),
        ("alsa", "null", "no such"),
    ],
)
def test_live_input_missing_is_refused(where: str, audio: str, words: str):
    from ergon.api.errors import DeviceError

    ready = prepare("s.yaml", PlayOptions(audio=audio, audio_in=where), Report())
    with pytest.raises(DeviceError, match=words):
        begin(ready.stage, ready.config, Report())


def test_live_input_off_plays_files():
    heard = playing(lambda: None, audio="null:fast", audio_in="none")
    assert heard.sentence.startswith("no input: each input of the score plays its file")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"record_input": "s.yaml"}, ".wav"),
        ({"record_input": "rehearsal.wav"}, "exists"),
        ({"record_input": "new.wav", "from_": "1|2"}, "begins with the piece"),
    ],
)
def test_record_input_refuses_existing_files(options: dict[str, str], words: str):
    with pytest.raises(OptionError, match=words):
        prepare("s.yaml", PlayOptions(audio="null:fast", **options), Report())  # type: ignore[arg-type]


def test_render_input_file_and_score_requirements():
    with pytest.raises(OptionError, match=r"not a \.wav file that exists"):
        rendered("nowhere.wav")
    text = SCORE.replace("from: mic", "from: 1N")
    Path("s.yaml").write_text(text.replace("takes:", "marks: {}  #"))
    with pytest.raises(OptionError, match="this score has no inputs"):
        rendered("rehearsal.wav")


# --- servers ---


@pytest.fixture
def jack(name: str) -> Iterator[Jack]:
    server = Jack(name, rate=RATE)
    with server.run():
        yield server


@contextlib.contextmanager
def source(where: str, n_channels: int = 1, rate: int = RATE) -> Iterator[Callable[[], None]]:
    """A client that plays a second of noise, when it is called, on all of its channels."""
    out = _core.AudioOut(where, rate, n_channels)

    def play() -> None:
        sound = np.repeat(noise(rate, 5)[:, None], n_channels, axis=1)
        out.play(np.concatenate([np.zeros((rate // 4, n_channels), np.float32), sound]))
        assert out.finish(PATIENCE)

    try:
        yield play
    finally:
        out.close()


def sounds_as(input_file: str) -> None:
    """What was played is what the score makes of a file, sample for sample."""
    sound, first = samples("sound.wav"), int(Path("first").read_text())
    again = rendered(input_file)[first:]
    assert np.abs(sound).max() > 1e-4
    assert len(sound) > RATE
    assert np.array_equal(again[: len(sound)], sound[: len(again)])


def recorded(listened: _core.SoundInput) -> Comparison:
    """What was heard beside what was played into it; the render of it is what sounded."""
    assert listened.live
    assert listened.error is None
    took = samples("in.wav")
    assert listened.recorded == len(took)
    sounds_as("in.wav")
    return compare(took[:, None], noise(RATE, 5)[:, None])


def test_jack_input_recording_renders_same_samples(jack: Jack):
    with source("jack:none") as play:
        listened = playing(play, audio="null", audio_in="jack:^ergon:out_1", record_input="in.wav")
    assert "client ergon_in, from ergon:out_1" in listened.sentence
    assert f"1 channel in at {RATE} Hz, {jack.block} frames" in listened.sentence
    assert "to the instrument" in listened.sentence
    assert "to the loudspeaker" in listened.sentence
    result = recorded(listened)
    assert result.exact or listened.gaps or listened.discarded, result


def test_auto_input_uses_output_jack_server(jack: Jack):
    ready = prepare("s.yaml", PlayOptions(audio="auto"), Report())
    performance = begin(ready.stage, ready.config, Report())
    listened = performance.sound_input()
    performance.stop()
    performance.close(PATIENCE)
    assert "system:capture_1 and on" in listened.sentence


def test_jack_at_another_rate_is_converted(jack: Jack):
    Path("s.yaml").write_text(SCORE.replace("48kHz", "44100Hz"))
    with source("jack:none") as play:
        listened = playing(play, audio="null", audio_in="jack:^ergon:out_1", record_input="in.wav")
    assert "converted to 44100 Hz" in listened.sentence
    took = samples("in.wav")
    assert 0.4 < np.abs(took).max() < 1.0
    sounds_as("in.wav")


def test_jack_output_and_input_return_after_the_server_dies(name: str):
    """libjack frees all clients of a process when one is opened after their server has ended."""
    Path("s.yaml").write_text(SCORE.replace("tail: 3s", "tail: 300s"))
    server = Jack(name, rate=RATE)
    ready = prepare("s.yaml", PlayOptions(audio="jack:none", audio_in="jack:none"), Report())
    with server.run() as process:
        performance = begin(ready.stage, ready.config, Report())
        until(lambda: performance.status().played > RATE // 10, "sound")
        process.kill()
        until(lambda: len(performance.sound_events()) == 2, "both losses")
    with server.run():
        until(lambda: len(performance.sound_events()) == 4, "both returns")
        sentences = [event.sentence for event in performance.sound_events()]
    performance.stop()
    performance.close(PATIENCE)
    assert sum("lost" in sentence for sentence in sentences) == 2, sentences
    assert sum("back" in sentence for sentence in sentences) == 2, sentences


def test_jack_input_reconnects_after_server_restart(name: str):
    Path("s.yaml").write_text(SCORE.replace("tail: 3s", "tail: 300s"))
    server = Jack(name, rate=RATE)
    with server.run() as process:
        options = PlayOptions(audio="null", audio_in="jack:none")
        ready = prepare("s.yaml", options, Report())
        performance = begin(ready.stage, ready.config, Report())
        until(lambda: performance.status().played > RATE // 10, "sound")
        process.kill()
        until(lambda: performance.sound_events(), "the loss")
        until(lambda: performance.status().input_gaps > 0, "a gap")
    with server.run():
        until(lambda: len(performance.sound_events()) == 2, "the return")
        lost, back = (event.sentence for event in performance.sound_events())
    assert lost == "the input jack:none is lost; it is silent until it is found again"
    assert back == "the input jack:none is back"
    performance.stop()
    performance.close(PATIENCE)


def test_pulse_excites_a_bell_from_the_monitor_of_a_sink(work_folder: Path):
    server = Pulse(work_folder, rate=RATE, channels=2)
    options: dict[str, str | None] = {
        "audio": "null",
        "audio_in": "pulse:dome.monitor",
        "record_input": "in.wav",
    }
    words = "pulse (Monitor of Null Output): 1 channel in at 48000 Hz"
    with server.run():
        for _ in range(TRIES):
            with source("pulse:dome", 2) as play:
                listened = playing(play, **options)
            assert listened.sentence.startswith(words)
            result = recorded(listened)
            if result.exact:
                break
            Path("in.wav").unlink()
            Path("sound.wav").unlink()
        else:
            pytest.fail(f"in none of {TRIES} tries every frame was heard; in the last: {result}")
        ready = prepare("s.yaml", PlayOptions(audio="null", audio_in="pulse:nowhere"), Report())
        with pytest.raises(_core.EngineError, match="no source nowhere"):
            _core.Performance(
                ready.stage.simulation,
                ready.stage.mixer(),
                audio="null",
                audio_in="pulse:nowhere",
            )
