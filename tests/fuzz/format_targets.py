"""Files of other programs: heads, loudspeakers, strokes, tables, measured keys, meshes."""

from __future__ import annotations

import atexit
import io
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import soundfile
from corrupted import corrupted

from ergon.common.sound_files import is_sound
from ergon.exchange import sofa
from ergon.exchange.layout_files import FORMS, Form, LayoutFileError, as_yaml
from ergon.exchange.sofa import SofaError
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import TakeError
from ergon.workshop.bells import resonances, stroke
from ergon.workshop.metrology import calibration_file, comparison
from ergon.workshop.metrology.gesture import MeasurementError
from tests.fuzz.harness import Target
from tests.fuzz.texts import NUMBERS, damaged
from tests.scores.test_corrupted_takes import FORMATS

SUPPORT = Path(__file__).parents[1] / "support"
MEMORY_MAX = 1 << 30  # bytes that a reader of a file of some kilobytes may hold


def _head(file: h5py.File, **how: object) -> None:
    """Responses of four directions, packed as `how` says."""
    file.attrs["SOFAConventions"] = np.bytes_("SimpleFreeFieldHRIR")
    file.create_dataset("SourcePosition", data=[(90.0 * i, 10.0, 1.4) for i in range(4)])
    file["SourcePosition"].attrs["Type"] = np.bytes_("spherical")
    file.create_dataset("Data.SamplingRate", data=[48_000.0])
    responses = np.random.default_rng(1).normal(size=(4, 2, 16))
    file.create_dataset("Data.IR", data=responses, **how)


def _elsewhere(file: h5py.File) -> None:
    """Responses that lie in another place: outside, in a virtual data set, behind a link."""
    _head(file)
    del file["Data.IR"]
    file.create_dataset("outside", (4, 2, 16), "i1", external=[("/etc/passwd", 0, 128)])
    layout = h5py.VirtualLayout(shape=(4, 2, 16), dtype="f8")
    layout[...] = h5py.VirtualSource(".", "Data.IR", shape=(4, 2, 16))
    file.create_virtual_dataset("Data.IR", layout)
    file["soft"] = h5py.SoftLink("/outside")


@cache
def _heads() -> tuple[bytes, ...]:
    built: list[bytes] = []
    ways: tuple[Callable[[h5py.File], None], ...] = (
        _head,
        lambda file: _head(file, compression="gzip", shuffle=True, fletcher32=True),
        lambda file: _head(file, chunks=(1, 2, 16), maxshape=(None, 2, 16)),
        lambda file: _head(file, dtype="i4", scaleoffset=0, chunks=True),
        _elsewhere,
    )
    for version in ("earliest", "latest"):
        for method in ways:
            complete = io.BytesIO()
            with h5py.File(complete, "w", libver=version) as file:
                method(file)
            built.append(complete.getvalue())
    return tuple(built)


def _sofa(chance: random.Random) -> bytes:
    complete = chance.choice(_heads())
    # Headers and the tables of chunks lie anywhere, so half of the damage does too.
    if chance.random() < 0.5:
        return next(corrupted(complete, 1, chance.randrange(1 << 30), *_heads()))
    data = bytearray(complete)
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        data[chance.randrange(len(data))] = chance.choice((0, 1, 255, chance.randrange(256)))
    return bytes(data)


@cache
def _forks() -> subprocess.Popen[str]:
    reader = str(Path(sofa.__file__).with_name("sofa_reader.py"))
    words = [sys.executable, "-P", str(SUPPORT / "sofa_forks.py"), reader]
    forks = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(forks.communicate)  # its input ends, and then it does
    return forks


def _read_sofa(data: bytes, folder: Path) -> None:
    """Read it as `sofa.read` does, in a process that is forked."""
    source, target = folder / "a.sofa", folder / "answer"
    source.write_bytes(data)
    forks = _forks()
    assert forks.stdin is not None
    assert forks.stdout is not None
    forks.stdin.write(f"{source}\t{target}\n")
    forks.stdin.flush()
    status, seconds, memory = forks.stdout.readline().split()
    assert os.WIFSIGNALED(int(status)) or int(status) == 0, f"the reader ends with {status}"
    assert float(seconds) < 10.0, f"the reader takes {seconds} s"
    assert int(memory) < MEMORY_MAX, f"the reader holds {memory} bytes"
    with target.open("rb") as answer:
        sofa.responses_of(answer, source)


SPEAKERS = [(30.0, 0.0, 2.0), (-30.0, 0.0, 2.0), (110.0, 5.0, 1.9), (-110.0, 0.0, 2.0)]
LAYOUT_WORDS = (
    "[",
    "]",
    "{",
    "}",
    ",",
    "null",
    "true",
    '"Channel":',
    "<!DOCTYPE a>",
    "&amp;",
    "*a",
)


def _layout(form: Form) -> Target:
    complete = form.write(SPEAKERS, range(1, len(SPEAKERS) + 1), "a room")

    def case(chance: random.Random) -> bytes:
        if chance.random() < 0.02:
            return chance.choice((b"[", b'{"a":', b"- ", b"<a>", b"9")) * chance.randrange(9999)
        if chance.random() < 0.5:
            return damaged(complete, chance, LAYOUT_WORDS).encode(errors="surrogatepass")
        return next(corrupted(complete.encode(), 1, chance.randrange(1 << 30)))

    def read(data: bytes, _: Path) -> Iterator[str]:
        yield as_yaml(form.read(data).speakers, "a room", 3.0)

    return Target(f"layout{form.ending}", case, read, (LayoutFileError,), 150, 30_000)


@cache
def _strokes() -> tuple[bytes, ...]:
    t = np.arange(2400) / 8000
    sound = 0.5 * np.exp(-20 * t)[:, None] * np.sin(2 * np.pi * 440 * t)[:, None]
    built = []
    for form, subtype in (
        ("WAV", "PCM_16"),
        ("FLAC", "PCM_24"),
        ("AIFF", "PCM_16"),
        ("W64", "FLOAT"),
    ):
        file = io.BytesIO()
        soundfile.write(file, sound, 8000, format=form, subtype=subtype)
        built.append(file.getvalue())
    return tuple(built)


def _stroke(chance: random.Random) -> tuple[str, bytes]:
    number = chance.randrange(len(_strokes()))
    complete = _strokes()[number]
    single = (".wav", ".flac", ".aiff", ".w64")[number]
    suffix = single if chance.random() < 0.7 else chance.choice((".wav", ".flac", ".txt"))
    return suffix, next(corrupted(complete, 1, chance.randrange(1 << 30), *_strokes()))


def _read_stroke(case: tuple[str, bytes], folder: Path) -> None:
    """As `ergon bell` begins; what follows depends on the sound alone."""
    suffix, data = case
    path = folder / f"a{suffix}"
    path.write_bytes(data)
    if is_sound(path):
        stroke.stroke("a", *stroke.read(path))
    else:
        resonances.read(path)


def _table(chance: random.Random) -> tuple[str, bytes]:
    """A table whose cells are other numbers, or none."""
    suffix = chance.choice((".csv", ".tsv"))
    rows = [line.split(",") for line in FORMATS[".csv"][0].decode().splitlines()]
    for _ in range(chance.choice((1, 1, 2, 8))):
        row = chance.choice(rows)
        row[chance.randrange(len(row))] = chance.choice((*NUMBERS, "", "NaN", "-inf", "a", "t [s]"))
    between = "," if suffix == ".csv" else "\t"
    return suffix, "\n".join(between.join(row) for row in rows).encode()


def _read_table(case: tuple[str, bytes], folder: Path) -> Iterator[str]:
    suffix, data = case
    path = folder / f"a{suffix}"
    path.write_bytes(data)
    for column in summary(path).columns:
        yield f"{column.low_value} … {column.high_value}"
        assert not column.is_time or np.isfinite([column.first_value, column.last_value]).all()


MEASURED = """\
ergon: 1
M: 412.5g # ± 0.8
K: 61.2N/m # ± 0.2
Z: 1.18Ns/m # ± 0.01
rest: 0.4mm # ± 0.01
dry: 12mN # ± 1
modes:
  - {M: 12.5g, f: 83.1Hz, t60: 0.21s} # ± 0.3 0.2 0.01
  - {M: 5g, f: 210Hz, t60: infs} # ± 0.3 0.2 0.01
correlations:
  - M
  - K 0.120000
  - Z -0.010000 0.300000
  - mode1.M 0.5 0.1 0.2
noise: 0.004mm
date: 2026-03-01
takes:
  - 0000
"""
MEASURED_WORDS = ("M:", "g", "N/m", "# ±", "-", ".", "1e999g", "0Hz", "inf", "mode1.f", "1.0000")


def _read_measured(texts: tuple[str, str], _: Path) -> None:
    """As `ergon metrology compare` does."""
    first, other = map(calibration_file.read, texts)
    comparison.differences(first, other)
    comparison.chi_squared(first, other)
    comparison.replay_difference(first.parameters, other.parameters)


def _measured(chance: random.Random) -> tuple[str, str]:
    return MEASURED, damaged(MEASURED, chance, MEASURED_WORDS)


TARGETS = (
    Target("SOFA", _sofa, _read_sofa, (SofaError,), 100, 25_000),
    *(_layout(form) for form in FORMS.values()),
    Target(
        "strokes",
        _stroke,
        _read_stroke,
        (stroke.NotAStrokeError, resonances.TableError),
        100,
        30_000,
    ),
    Target("tables", _table, _read_table, (TakeError,), 100, 30_000),
    Target("measured keys", _measured, _read_measured, (MeasurementError,), 60, 10_000),
)
