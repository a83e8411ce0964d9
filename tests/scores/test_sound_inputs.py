"""Inputs of a sound card in a score: what is read, what is refused, and what their files give."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from numpy.typing import NDArray

from ergon.notation.text.errors import Diagnostic
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import SoundInput
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import Stage, stage

RATE = 44_100
SCORE = """\
ergon: 1
takes: {{mic: {{{fields}}}}}
instruments:
  bell:
    modules:
      m: {{MAS: {{M: 2g}}}}
      hand: {{{drive}: {{to: m, from: mic{more}}}}}
    out: {{SOX: m}}
render: {{tail: 0.1s}}
"""


def text(fields: str, drive: str = "ENF", more: str = "") -> str:
    return SCORE.format(fields=fields, drive=drive, more=more)


def read(written: str) -> Piece:
    loaded = load("s.yaml", text=written)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def refused(written: str) -> list[Diagnostic]:
    return [found for found in load("s.yaml", text=written).diagnostics if found.code[0] == "E"]


def rendered(staged: Stage) -> NDArray[np.float64]:
    out = np.empty((staged.n_frames, 1))
    staged.simulation.process(out)
    return out[:, 0]


def wave(path: str, *channels: NDArray[np.float64], rate: int = RATE) -> None:
    soundfile.write(path, np.stack(channels, 1), rate, subtype="FLOAT")


def noise(n_frames: int, seed: int = 1) -> NDArray[np.float64]:
    """As a file of single floats holds it."""
    sound = np.random.default_rng(seed).uniform(-1.0, 1.0, n_frames)
    return sound.astype(np.float32).astype(np.float64)


def test_sound_input_default_fields():
    take = read(text("input: 2, gain: -2mN")).takes["mic"]
    assert take.path is None
    assert take.input == SoundInput(2, -2e-3, True, 20.0, 2e-3)
    take = read(text("input: 1, gain: 0.1mm, clamp: 1cm, highpass: 5Hz", "ENX")).takes["mic"]
    assert take.input == SoundInput(1, 1e-4, False, 5.0, 1e-2)


def test_values_by_osc_glide_and_have_no_filter(work_folder: Path):
    take = read(text("input: osc, gain: 2mN")).takes["mic"]
    assert take.input == SoundInput(None, 2e-3, True, None, 2e-3, 0.02)
    take = read(text("input: osc, gain: 1mm, clamp: 2mm, glide: 0s", "ENX")).takes["mic"]
    assert take.input == SoundInput(None, 1e-3, False, None, 2e-3, 0.0)
    x = noise(99)
    wave("x.wav", x)
    written = text("input: osc, gain: 1mm, clamp: 0.5mm, file: x.wav", "ENX")
    got = rendered(stage(read(written)))
    assert np.array_equal(got[1:100], np.clip(1e-3 * x, -0.5e-3, 0.5e-3))
    assert not got[100:].any()
    assert not rendered(stage(read(text("input: osc, gain: 1mm", "ENX")))).any()


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        ("", "E103", "neither a file nor an input"),
        ("input: 1", "E103", "no 'gain'"),
        ("input: 0, gain: 1N", "E202", "from 1 to 64"),
        ("input: 65, gain: 1N", "E202", "from 1 to 64"),
        ("input: 1, gain: 3", "E204", "2mN or 0.1mm"),
        ("input: 1, gain: 0N", "E204", "must not be 0"),
        ("input: 1, gain: 2kN", "E202", "maximum"),
        ("input: 1, gain: 2mm", "E304", "drives an ENX"),
        ("input: 1, gain: 2N, clamp: 1mm", "E111", "`gain` is a force"),
        ("input: 1, gain: 2N, clamp: -1N", "E202", "without a sign"),
        ("input: 1, gain: 2N, trim: 1s..2s", "E111", "has no trim"),
        ("input: 1, gain: 2N, smooth: 9Hz", "E111", "has no smooth"),
        ("input: 1, gain: 2N, channel: 1", "E111", "the input has none"),
        ("input: 1, gain: 2N, file: x.csv", "E206", ".wav"),
        ("input: 1, gain: 2N, file: x.wav", "E107", "x.wav"),
        ("input: 1, gain: 2N, glide: 1ms", "E111", "an input of the sound card has no glide"),
        ("input: osc, gain: 2N, highpass: 9Hz", "E111", "an input by OSC has no highpass"),
        ("input: osc, gain: 2N, glide: 61s", "E202", "the longest glide is 60 s"),
        ("input: osc", "E103", "no 'gain'"),
        ("input: osk, gain: 1N", "E201", "neither a whole number nor osc"),
    ],
)
def test_sound_input_mistakes_codes(work_folder: Path, fields: str, code: str, words: str):
    (result,) = refused(text(fields))
    assert result.code == code
    assert words in result.message


def test_gain_and_clamp_without_input_are_refused(work_folder: Path):
    wave("x.wav", noise(9))
    (result,) = refused(text("file: x.wav, gain: 1N"))
    assert (result.code, "belongs to a take with `input`" in result.message) == ("E111", True)


def test_sound_input_with_at_is_refused():
    (found,) = refused(text("input: 1, gain: 1N", more=", at: 1s"))
    assert (found.code, "remove `at`" in found.message) == ("E111", True)


@pytest.mark.parametrize(
    ("written", "code", "words"),
    [
        (text("input: 1, gain: 1N, highpass: 30kHz"), "E308", "half of the rate"),
        (text("input: 1, gain: 1N, file: x.wav, channel: 3"), "E310", "no channel '3'"),
        (text("input: 3, gain: 1N, file: x.wav"), "E310", "no channel '3'"),
        (
            text("input: 1, gain: 1N")
            + "keys: {k: {M: 400g, K: 60N/m}}\nplayers: {p: {key: k}}\n"
            + "parts: {p: [{at: 1|1, play: mic}]}\n",
            "E308",
            "no key",
        ),
    ],
)
def test_sound_input_stage_errors(work_folder: Path, written: str, code: str, words: str):
    wave("x.wav", noise(9), noise(9))
    piece = read(written)
    with pytest.raises(StageError) as raised:
        stage(piece)
    (result,) = raised.value.diagnostics
    assert result.code == code
    assert words in result.message


def test_sound_input_file_channel(work_folder: Path):
    wave("two.wav", noise(100, 1), noise(100, 2))
    wave("one.wav", noise(100, 2))
    fields = "gain: 1mm, highpass: 20Hz, file"

    def sound(written: str) -> NDArray[np.float64]:
        return rendered(stage(read(text(written, "ENX"))))

    second = sound(f"input: 2, {fields}: two.wav")
    assert np.array_equal(second, sound(f"input: 7, {fields}: one.wav"))
    assert np.array_equal(second, sound(f"input: 1, {fields}: two.wav, channel: 2"))
    assert not np.array_equal(second, sound(f"input: 1, {fields}: two.wav"))


def test_sound_input_file_highpass_and_clamp(work_folder: Path):
    x = noise(RATE // 2)
    wave("x.wav", x)
    piece = read(text("input: 1, gain: 1mm, highpass: 300Hz, clamp: 0.7mm, file: x.wav", "ENX"))
    got = rendered(stage(piece))
    # It lasts as long as the file, and the tail.
    assert len(got) == len(x) + RATE // 10
    # The bilinear transform of an analogue Butterworth, by its difference equation.
    k = np.tan(np.pi * 300.0 / RATE)
    a = 1.0 + np.sqrt(2.0) * k + k * k
    y = np.zeros(len(x) + 2)
    padded = np.concatenate([[0.0, 0.0], x])
    for n in range(2, len(padded)):
        forth = padded[n] - 2.0 * padded[n - 1] + padded[n - 2]
        back = 2.0 * (k * k - 1.0) * y[n - 1] + (1.0 - np.sqrt(2.0) * k + k * k) * y[n - 2]
        y[n] = (forth - back) / a
    expected = np.clip(1e-3 * y[2:], -0.7e-3, 0.7e-3)
    assert np.count_nonzero(np.abs(expected) == 0.7e-3) > 1000
    assert got[0] == 0.0
    assert np.allclose(got[1 : len(x) + 1], expected, rtol=0.0, atol=1e-12)
    assert not got[len(x) + 1 :].any()


def test_sound_input_file_resampled_to_score_rate(work_folder: Path):
    t = np.arange(48_000 // 4) / 48_000
    wave("x.wav", 0.5 * np.sin(2 * np.pi * 440.0 * t), rate=48_000)
    got = rendered(stage(read(text("input: 1, gain: 1m, highpass: 0.01Hz, file: x.wav", "ENX"))))
    inside = slice(100, RATE // 4 - 100)
    expected = 0.5 * np.sin(2 * np.pi * 440.0 * (np.arange(len(got)) - 1) / RATE)
    # The spline is within 1e-6 of a slow sine; 0.01 Hz is nearly no filter.
    assert np.allclose(got[inside], expected[inside], rtol=0.0, atol=2e-3)


def test_scores_without_inputs_keep_their_digest(work_folder: Path):
    soundfile.write("x.wav", np.linspace(-0.5, 0.5, 9), RATE, subtype="PCM_16")
    plain = digest_of(read(text("file: x.wav", "ENX")))
    other = digest_of(read(text("input: 1, gain: 1m, file: x.wav", "ENX")))
    assert plain != other
    # As it was before there were inputs.
    assert plain == "c2fdf2e9e89ad00464cc07c163e19c045c279b17c19b3b4a73e7651d8084bb92"
