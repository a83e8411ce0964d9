"""Damaged takes are refused with a sentence, whatever is wrong with them."""

import contextlib
import io
from collections import Counter
from collections.abc import Iterator

import motion_files
import numpy as np
import pytest
import soundfile
from corrupted import corrupted
from recordings import EVENTS, Axis, chunk, end, event, header, row, rows
from sweep import few

from ergon import _core
from ergon.cli.console import Console
from ergon.cli.outcome import Outcome
from ergon.cli.take_info import take as take_info
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read


def csv() -> bytes:
    lines = "".join(f"{i / 100},{np.sin(i):.4f},{np.cos(i):.4f}\n" for i in range(40))
    return f"# a hand\nt [s],x [mm],y [mm]\n{lines}".encode()


def wav(subtype: str = "PCM_16", form: str = "WAV") -> bytes:
    file = io.BytesIO()
    x = np.sin(np.arange(200.0)).reshape(100, 2)
    soundfile.write(file, x, 1000, subtype=subtype, format=form)
    return file.getvalue()


def npz(packed: bool, **arrays) -> bytes:
    file = io.BytesIO()
    arrays = arrays or {"t": np.arange(50) / 100, "x [mm]": np.sin(np.arange(50.0))}
    (np.savez_compressed if packed else np.savez)(file, **arrays)
    return file.getvalue()


def recorded() -> bytes:
    item = (row(i, Axis(i * 1e-6, 0.5, 0.25, 16, i), Axis(0.001)) for i in range(20))
    axes = (("remi", "k2"), ("ada", "k1"))
    lines = chunk(EVENTS, event(3, "play") + event(5, "stop"))
    return header(axes, about='{"day": "x"}') + rows(*item) + lines + end()


def captured() -> Iterator[tuple[str, tuple[bytes, ...]]]:
    places = motion_files.curve(9)
    places[4, 1] = np.nan
    t = np.arange(9) / 100
    yield (
        ".c3d",
        (
            motion_files.c3d(places),
            motion_files.c3d(places, scale=0.0625, processor="mips", analog=1),
            motion_files.c3d(places, processor="dec"),
        ),
    )
    yield ".bvh", (motion_files.bvh(np.round(np.sin(np.arange(60.0)).reshape(5, 12), 3)),)
    yield (
        ".tsv",
        (
            motion_files.qtm(places, titles=True, leading=2),
            motion_files.qtm_bodies(places[:4]),
            b"t [s]\tx [mm]\n0\t0\n1\t2\n",
        ),
    )
    types = motion_files.declared("{1MTD XPOS {x, y, z} 1FTD XMOV {XPOS position;}}")
    yield ".sdif", (motion_files.sdif(types, motion_files.moving(t, places[:, 0])),)


FORMATS = {
    ".csv": (csv(), motion_files.optitrack(motion_files.curve(9), timed=True)),
    ".wav": (wav(), wav("FLOAT"), wav("DOUBLE", "RF64"), wav("PCM_24", "WAVEX")),
    ".npz": (npz(False), npz(True), npz(True, **{"x [mm]": np.arange(9, dtype=">i2")})),
    ".take": (recorded(),),
    **dict(captured()),
}
POINT = {
    ".c3d": "RWRI.auto",
    ".tsv": "LWRI.x",
    ".csv": "Hand:LWRI.x",
    ".bvh": "hand.x",
    ".sdif": "XPOS.x",
}
CHANNEL = {**POINT, ".csv": "x", ".wav": "1", ".npz": "x", ".take": "remi"}
MEANT = (TakeError, Outcome, OSError)


def internal(path, quiet) -> list[str]:
    """What goes wrong that nobody meant, in all that reads a take."""
    result = []
    ways = [lambda: quiet(path)] if path.suffix != ".wav" else []
    if path.suffix in POINT:
        for channel in (None, POINT[path.suffix]):
            ways += [lambda c=channel, u=unit: played(path, c, None, u) for unit in (None, 0.01)]
    for channel, rate in ((None, None), ("x", None), ("1", None), ("remi", None), ("x", 100.0)):
        ways.append(lambda c=channel, r=rate: played(path, c, r))
    for method in ways:
        try:
            method()
        except MEANT:
            pass
        except BaseException as error:  # a panic of the core is no Exception
            result.append(f"{type(error).__name__}: {error}")
    return result


def played(path, channel, rate, unit=None):
    samples = read(path, channel, rate=rate, unit=unit)
    with contextlib.suppress(_core.EngineError):
        _core.Take(samples.t, samples.x)


def tried(suffix, count, seed, tmp_path, capsys) -> Counter:
    path = tmp_path / f"hand{suffix}"
    complete = FORMATS[suffix]
    others = [data for every in FORMATS.values() for data in every]
    result: Counter = Counter()
    n = 0
    for i, data in enumerate(complete):
        for damaged in corrupted(data, count // len(complete), seed + i, *others):
            path.write_bytes(damaged)
            result.update(internal(path, lambda path: take_info(Console(json=True), path)))
            n += 1
            if n % 500 == 0:
                capsys.readouterr()
    return result


@pytest.mark.parametrize("suffix", few(FORMATS, 3))
def test_damaged_takes_are_refused(tmp_path, capsys, suffix):
    for data in FORMATS[suffix]:
        (tmp_path / f"whole{suffix}").write_bytes(data)
        rate = 100.0 if data is FORMATS[".npz"][2] else None
        unit = 0.01 if suffix in (".bvh", ".sdif") else None
        channel = CHANNEL[suffix]
        if data is FORMATS[".tsv"][2]:
            channel = "x"
        elif data is FORMATS[".csv"][1]:
            channel = POINT[".csv"]
        assert len(read(tmp_path / f"whole{suffix}", channel, rate=rate, unit=unit).x) >= 2
    assert tried(suffix, 1200, 1, tmp_path, capsys) == {}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", FORMATS)
def test_thousands_of_damaged_takes_are_refused(tmp_path, capsys, suffix):
    """Together some 66,000 files."""
    assert tried(suffix, 16_448, 1000, tmp_path, capsys) == {}
