"""`ergon fold`: files for two ears, stereo, Ambisonics and other rooms, and what is refused."""

import hashlib
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from commands import forked
from scipy.signal import resample_poly

from ergon.exchange.wave import WaveWriter, read_blocks, read_info
from ergon.exchange.wave_header import Stamp, WaveFormat, pack

SCORE = """\
ergon: 1
title: Sky
instruments:
  sky: {BANK: {count: 40, f: 200Hz..4kHz, t60: 50ms, M: 1g, place: galaxy}, place: {across: 6m}, out: {SOV: sky.all}}
strikes: {s: {to: sky.all, at: 1|1, for: 0.2s, rate: 5Hz, impulse: 1uNs}}
mix: {layout: layouts/dome24.yaml, route: {from: sky, to: nearest}}
render: {file: sky.wav, tail: 0.1s}
"""  # noqa: E501


def ergon(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return forked(words, folder)


EARS = ("--to", "binaural")


def noise(path: Path, n_frames: int, n_channels: int = 24, *, peak: float = 0.1) -> np.ndarray:
    frames = np.random.default_rng(3).uniform(-peak, peak, (n_frames, n_channels))
    frames = frames.astype(np.float32)
    with path.open("wb") as file:
        format = WaveFormat(48_000, n_channels, "float")
        writer = WaveWriter(file, format, n_frames, Stamp("noise"))
        writer.write(frames)
        writer.close()
    return frames.astype(np.float64)


def samples(path: Path) -> np.ndarray:
    return np.concatenate([*read_blocks(path)])


def test_fold_reads_the_layout_of_a_rendered_file(tmp_path: Path):
    """So that it folds without a word; and what is folded to a field says that too."""
    (tmp_path / "a.yaml").write_text(SCORE)
    assert ergon(tmp_path, "render", "a.yaml").returncode == 0
    for words in (("binaural",), ("ambix5",), ("stereo", "--bits", "16")):
        done = ergon(tmp_path, "fold", "sky.wav", "--to", *words)
        assert done.returncode == 0, done.stderr
    n_frames = read_info(tmp_path / "sky.wav").n_frames
    shapes = [samples(tmp_path / f"sky-{to}.wav").shape for to in ("ambix5", "stereo")]
    assert shapes == [(n_frames, 36), (n_frames, 2)]
    assert read_info(tmp_path / "sky-stereo.wav").format.bits == 16
    done = ergon(tmp_path, "fold", "sky-ambix5.wav", "--to", "ring24", "--json")
    assert done.returncode == 0, done.stderr
    (folded,) = [json.loads(line) for line in done.stdout.splitlines()]
    assert (folded["channels"], folded["gain_db"]) == (24, 0.0)
    assert ergon(tmp_path, "fold", "sky-ambix5-ring24.wav", "--to", "stereo").returncode == 0


def test_fold_to_binaural_equals_scipy_convolution(tmp_path: Path):
    """By scipy, over more than a block of the file and of the engine."""
    from scipy.signal import fftconvolve

    from ergon.api.layouts import read_layout
    from ergon.space import fold_filters, head

    frames = noise(tmp_path / "in.wav", 70_000)
    done = ergon(tmp_path, "fold", "in.wav", *EARS, "--layout", "dome24", "-o", "o.wav")
    assert done.returncode == 0, done.stderr
    filters = fold_filters.to_ears(
        fold_filters.Field(read_layout("dome24").speakers), head.kemar(), 48_000.0
    )
    wanted = sum(fftconvolve(frames[:, i, None], filters[i].T, axes=0) for i in range(24))
    np.testing.assert_allclose(samples(tmp_path / "o.wav"), wanted, atol=2e-6)


def test_fold_to_binaural_with_known_hash(tmp_path: Path):
    """These bytes on every machine: no library's sine or transform stands in between."""
    noise(tmp_path / "in.wav", 3_000)
    for name in ("a.wav", "b.wav"):
        words = ("fold", "in.wav", "--to", "binaural", "--layout", "dome24", "-o", name)
        assert ergon(tmp_path, *words).returncode == 0
    first, second = ((tmp_path / name).read_bytes() for name in ("a.wav", "b.wav"))
    assert first == second
    known = "34af16a45dd6405b"
    assert hashlib.sha256(first).hexdigest()[:16] == known


def test_fold_of_long_and_empty_files(tmp_path: Path):
    """RF64, as files beyond 4 GB are; and a file of no frames."""
    frames = noise(tmp_path / "in.wav", 500)
    with (tmp_path / "long.wav").open("wb") as file:
        format = WaveFormat(48_000, 24, "float")
        writer = WaveWriter(file, format, 500, Stamp("long"), riff_limit=100)
        writer.write(frames.astype(np.float32))
        writer.close()
    assert read_info(tmp_path / "long.wav").container == "RF64"
    noise(tmp_path / "none.wav", 0)
    for name in ("in", "long", "none"):
        done = ergon(tmp_path, "fold", f"{name}.wav", "--to", "stereo", "--layout", "dome24")
        assert done.returncode == 0, done.stderr
    short, long = (samples(tmp_path / f"{name}-stereo.wav") for name in ("in", "long"))
    np.testing.assert_array_equal(short, long)
    assert read_info(tmp_path / "none-stereo.wav").n_frames == 0


def test_fold_turned_down_before_clipping(tmp_path: Path):
    noise(tmp_path / "in.wav", 3_000, peak=0.9)
    words = ("fold", "in.wav", "--to", "stereo", "--layout", "dome24", "--bits")
    done = ergon(tmp_path, *words, "float", "-o", "float.wav")
    assert (done.returncode, "turned down" in done.stderr) == (0, False)
    clean = samples(tmp_path / "float.wav")
    assert np.abs(clean).max() > 1.1
    done = ergon(tmp_path, *words, "24")
    assert done.returncode == 0
    lower = float(done.stderr.split("turned down by ")[1].split(" dB")[0])
    built = samples(tmp_path / "in-stereo.wav")
    np.testing.assert_allclose(built, clean * 10 ** (-lower / 20), atol=1e-6)
    assert 10 ** (-3 / 20) < np.abs(built).max() <= 10 ** (-1 / 20)
    assert np.abs(resample_poly(built, 8, 1, axis=0)).max() < 10 ** (-0.5 / 20)


def test_fold_refuses_clipping_gain(tmp_path: Path):
    noise(tmp_path / "in.wav", 3_000, peak=0.9)
    words = ("fold", "in.wav", "--to", "stereo", "--layout", "dome24", "--bits", "24", "--gain")
    done = ergon(tmp_path, *words, "3dB")
    assert done.returncode == 2
    assert not (tmp_path / "in-stereo.wav").exists()
    highest = float(done.stderr.split("the most is ")[1].split(" dB")[0])
    assert ergon(tmp_path, *words, f"{highest - 0.01:.2f}dB").returncode == 0
    assert 0.98 < np.abs(samples(tmp_path / "in-stereo.wav")).max() <= 1.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("in.wav", "--to", "binaural"), "--layout dome24"),
        (("in.wav", "--to", "dome2", "--layout", "dome24"), "did you mean dome24?"),
        (("in.wav", "--to", "ambix8", "--layout", "dome24"), "1 to 7"),
        (("in.wav", "--to", "stereo", "--layout", "ambix3"), "has 24 channels, but ambix3 has 16"),
        (("in.wav", "--to", "stereo.yaml", "--layout", "dome24"), "is not a layout file"),
        (("in.wav", "--to", "stereo", "--layout", "dome24", "--gain", "6"), "--gain"),
        (("in.wav", "--to", "stereo", "--layout", "dome24", "--head", "x.sofa"), "--head"),
        (("in.wav", "--to", "binaural", "--layout", "dome24", "--head", "x.sofa"), "x.sofa"),
        (("in.wav", "--to", "ambix2", "--layout", "dome24", "-o", "a.flac"), "FLAC"),
        (("in.wav", "--to", "stereo", "--layout", "dome24", "-o", "in.wav"), "is an input"),
        (("nan.wav", "--to", "stereo", "--layout", "stereo"), "not finite"),
        (("no.wav", "--to", "stereo"), "no.wav"),
        (("text.wav", "--to", "stereo"), "not a WAVE file"),
    ],
)
def test_fold_refuses_wrong_layouts_and_files(tmp_path: Path, words: tuple[str, ...], message: str):
    noise(tmp_path / "in.wav", 10)
    noise(tmp_path / "nan.wav", 10, 2, peak=np.float32(1.0))
    data = bytearray((tmp_path / "nan.wav").read_bytes())
    data[-4:] = np.float32(np.nan).tobytes()
    (tmp_path / "nan.wav").write_bytes(data)
    (tmp_path / "text.wav").write_text("not a sound")
    before = sorted(tmp_path.iterdir())
    done = ergon(tmp_path, "fold", *words)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert message in done.stderr
    assert "internal error" not in done.stderr
    assert sorted(tmp_path.iterdir()) == before, "nothing is written"


@pytest.mark.parametrize("words", [("info",), ("fold", "--to", "stereo"), ("bell",), ("plot",)])
def test_truncated_wav_warning_by_each_sound_command(tmp_path: Path, words: tuple[str, ...]):
    t = np.arange(48_000) / 48_000.0
    stroke = 0.5 * np.exp(-8.0 * t) * np.sin(2 * np.pi * 440.0 * t)
    with (tmp_path / "cut.wav").open("wb") as file:
        writer = WaveWriter(file, WaveFormat(48_000, 2, 24), 96_000, Stamp("cut"))
        writer.write((np.stack([stroke, stroke], axis=1) * 2**31).astype(np.int32))
    command, *more = words
    more += ["--layout", "stereo"] if command == "fold" else []
    done = ergon(tmp_path, command, "cut.wav", *more)
    assert "shorter than its header says: of 96,000 frames 48,000 are there" in done.stderr
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("subtype", ["PCM_16", "FLOAT"])
@pytest.mark.parametrize(
    ("form", "suffix", "name"),
    [("W64", "w64", "Wave64"), ("CAF", "caf", "Core Audio"), ("AU", "au", "AU"),
     ("W64", "wav", "Wave64"), ("CAF", "yaml", "Core Audio")],
)  # fmt: skip
def test_fold_reports_other_sound_forms(tmp_path: Path, form, suffix, name, subtype):
    """As libsndfile writes them."""
    import soundfile

    path = tmp_path / f"in.{suffix}"
    soundfile.write(path, np.full((100, 2), 0.6), 48_000, subtype=subtype, format=form)
    for words in (("info",), ("bell",), ("fold", "--to", "stereo", "-o", "out.wav")):
        command, *more = words
        done = ergon(tmp_path, command, path.name, *more)
        message = f"{path.name}: it is sound in the form {name}"
        assert message in done.stderr, (command, done.stderr)
        assert "save it as WAV or FLAC" in done.stderr
        assert done.returncode == 2


def test_fold_skips_and_reports_lfe_channel(tmp_path: Path):
    """A file of 5.1 by its mask: the fourth channel has no place."""
    frames = np.zeros((200, 6))
    frames[10, 3] = 0.9
    frames[20, 0] = 0.5
    header = pack(WaveFormat(48_000, 6, 24), 200, Stamp("5.1"))
    mask = header.index(b"fmt ") + 8 + 20
    header = header[:mask] + (0x3F).to_bytes(4, "little") + header[mask + 4 :]
    data = (frames * 2**31).astype("<i4").view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()
    (tmp_path / "in.wav").write_bytes(header + data)
    done = ergon(tmp_path, "fold", "in.wav", "--to", "stereo", "-o", "out.wav")
    assert done.returncode == 0, done.stderr
    assert "channel 4 is for low-frequency effects, and is left out" in done.stderr
    listened = samples(tmp_path / "out.wav")
    assert not listened[10].any()
    right = np.sin(np.radians(-30.0))
    gains = np.sqrt((1 - right) / 2), np.sqrt((1 + right) / 2)
    np.testing.assert_allclose(listened[20], 0.5 * np.array(gains), atol=1e-6)


def test_fold_with_sofa_data_delay(tmp_path: Path):
    """A head that says when sound comes in Data.Delay alone: 30 samples between the ears."""
    import h5py

    from ergon.space.directions import angles, spread_directions

    directions = spread_directions(100)
    with h5py.File(tmp_path / "own.sofa", "w") as file:
        file.attrs["SOFAConventions"] = np.bytes_("SimpleFreeFieldHRIR")
        source_places = file.create_dataset(
            "SourcePosition", data=[angles(tuple(u)) for u in directions.tolist()]
        )
        source_places.attrs["Type"] = "spherical"
        responses = np.zeros((100, 2, 64))
        responses[:, :, 4] = 0.3
        file.create_dataset("Data.IR", data=responses)
        file.create_dataset("Data.SamplingRate", data=[48_000.0])
        file.create_dataset("Data.Delay", data=[[0.0, 30.0]])
    with (tmp_path / "in.wav").open("wb") as file:
        writer = WaveWriter(file, WaveFormat(48_000, 2, "float"), 500, Stamp("click"))
        frames = np.zeros((500, 2), np.float32)
        frames[100] = 0.5
        writer.write(frames)
        writer.close()
    words = ("--to", "binaural", "--layout", "stereo", "--head", "own.sofa", "-o", "o.wav")
    done = ergon(tmp_path, "fold", "in.wav", *words)
    assert done.returncode == 0, done.stderr
    left, right = np.abs(samples(tmp_path / "o.wav")).argmax(0)
    assert right - left == 30


def test_fold_with_user_sofa_head(tmp_path: Path):
    """The left ear of a made-up head hears only what is on the left."""
    import h5py

    from ergon.space.directions import angles, spread_directions

    directions = spread_directions(100)
    responses = np.zeros((100, 2, 64))
    responses[:, 0, 20] = np.where(directions[:, 0] < -0.1, 1.0, 0.01)
    responses[:, 1, 20] = np.where(directions[:, 0] > 0.1, 1.0, 0.01)
    with h5py.File(tmp_path / "own.sofa", "w") as file:
        file.attrs["SOFAConventions"] = np.bytes_("SimpleFreeFieldHRIR")
        places = [angles(tuple(one)) for one in directions.tolist()]
        source_places = file.create_dataset("SourcePosition", data=places)
        source_places.attrs["Type"] = "spherical"
        file.create_dataset("Data.IR", data=responses)
        file.create_dataset("Data.SamplingRate", data=[48_000.0])
    frames = noise(tmp_path / "in.wav", 5_000)
    frames[:, :] = 0.0
    words = (
        "in.wav",
        *EARS,
        "--layout",
        "dome24",
        "--head",
        "own.sofa",
        "-o",
        "o.wav",
    )
    with (tmp_path / "in.wav").open("wb") as file:
        writer = WaveWriter(file, WaveFormat(48_000, 24, "float"), 5_000, Stamp("left"))
        frames[100, 3] = 0.5
        writer.write(frames.astype(np.float32))
        writer.close()
    done = ergon(tmp_path, "fold", *words)
    assert done.returncode == 0, done.stderr
    left, right = np.abs(np.fft.rfft(samples(tmp_path / "o.wav"), axis=0))[200:400].mean(0)
    assert left > 30.0 * right
