"""Hostile scores through the real command, in little memory and bounded time.

Every score of a family is checked by one process that may have 2 GB of address space: each must be
refused with a sentence at a place in its own text (or in the file that it names), with exit code 1,
no traceback, and nothing written.
"""

import io
import json
import math
import os
import resource
import socket
import struct
import subprocess
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import recordings
from commands import ERGON
from hostile import (
    FILES,
    HEAD,
    KEY,
    NUMBERS,
    SIZES,
    TEXTS,
    YAML,
    generator,
    law,
    piece,
    strikes,
    take,
)
from patience import PATIENCE
from sweep import few

MEMORY = 2 << 30
SECONDS = 60  # of a processor, for a family; each takes some tenths


def wav(declared: int, channels: int = 1, bits: int = 16, rate: int = 44100) -> bytes:
    """A WAV file of 100 bytes of data whose header says something else."""
    frame = channels * bits // 8
    head = struct.pack("<4sI8sI", b"RIFF", (declared + 36) % 2**32, b"WAVEfmt ", 16)
    form = struct.pack("<HHIIHH", 1, channels, rate, rate * frame % 2**32, frame % 2**16, bits)
    return head + form + struct.pack("<4sI", b"data", declared) + bytes(100)


def npy(shape: str, data: bytes = b"", kind: str = "<f8") -> bytes:
    """An array whose header says what it is told to."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def npz(shape: str, data: bytes = b"", kind: str = "<f8") -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("t", "x"):
            archive.writestr(f"{name}.npy", npy(shape, data, kind))
    return file.getvalue()


PICKLE = b"cos\nsystem\n(S'touch pwned'\ntR."
Content = bytes | str | Callable[[], bytes]  # what is large is made where it is written
TAKES: Mapping[str, Content] = {
    "gigabyte.wav": wav(1 << 30),
    "channels0.wav": wav(100, channels=0),
    "channels65535.wav": wav(100, channels=65_535),
    "rate0.wav": wav(100, rate=0),
    "bits0.wav": wav(100, bits=0),
    "head.wav": b"RIFF\0\0",
    "huge.npz": npz("(1000000000000,)"),
    "negative.npz": npz("(-1,)"),
    "matrix.npz": npz("(1000, 1000, 1000, 1000)"),
    "bomb.npz": lambda: npz("(31250000,)", bytes(250_000_000)),
    "pickle.npz": npz("(1,)", PICKLE, "|O"),
    "code.npz": npz("__import__('os').system('touch pwned')"),
    "deep.npz": npz("(" * 5_000 + ")" * 5_000),
    "cut.npz": npz("(100,)", bytes(8)),
    "nan.npz": npz("(3,)", struct.pack("<3d", 0.0, 1.0, float("nan"))),
    "noise.npz": bytes(range(256)),
    "endless.csv": lambda: b"t [s],x [m]\n" + b"1" * 100_000_000,
    "commas.csv": lambda: b"t [s],x [m]\n" + b"," * 20_000_000,
    "columns.csv": lambda: b"t" + b",x" * 1_000_000 + b"\n1\n",
    "nan.csv": b"t [s],x [m]\n0,nan\n1,inf\n2,0\n",
    "back.csv": b"t [s],x [m]\n0,0\n-1,0\n2,0\n",
    "dense.csv": b"t [s],x [m]\n0,0\n1e-300,1\n1,1\n",
    "far.csv": b"t [s],x [m]\n0,0\n1e300,0\n",
    "nulls.csv": bytes(10_000),
    "nothing.csv": b"",
    "one.csv": b"t [s],x [m]\n0,0\n",
    "nothing.take": b"",
    "head.take": recordings.header()[:20],
    "axes.take": recordings.header((("", ""),) * 65),
    "length.take": recordings.header() + struct.pack("<IBI", 2**32 - 1, 2, 0),
    "zeros.take": lambda: recordings.header() + bytes(20_000_000),
    "nan.take": recordings.header()
    + recordings.rows(*(recordings.row(t, recordings.Axis(math.nan)) for t in range(9))),
    "far.take": recordings.header()
    + recordings.rows(*(recordings.row(t, recordings.Axis(0.0)) for t in (0, 2**64 - 1))),
    "frames.take": recordings.header(frames=0),
}


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))


def ergon(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command, in a folder, in little memory."""
    path = os.pathsep.join(
        str(Path(part).resolve()) for part in os.environ.get("PYTHONPATH", "").split(os.pathsep)
    )
    # A thread of numpy's own reserves more address space than the pieces need.
    few = {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": path}
    return subprocess.run(
        [*ERGON, *words],
        cwd=folder,
        env={**os.environ, **few},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        preexec_fn=limited,
        check=False,
    )


def write(path: Path, content: Content) -> None:
    data = content() if callable(content) else content
    path.write_bytes(data.encode() if isinstance(data, str) else data)


def refused(folder: Path, scores: Mapping[str, Content]) -> None:
    """Check that every score is refused at a place of its own, and that nothing else happens."""
    files = {}
    for number, (name, text) in enumerate(scores.items()):
        files[f"s{number}.yaml"] = name
        write(folder / f"s{number}.yaml", text)
    before = {path.name for path in folder.iterdir()}
    done = ergon(folder, "check", "--json", *files)
    shown = done.stdout + done.stderr
    assert "Traceback" not in shown
    assert "internal error" not in shown
    records = [json.loads(line) for line in shown.splitlines() if line.startswith("{")]
    errors = [record for record in records if record["event"] == "error" and record.get("line")]
    for record in errors:
        assert record["code"], record
        assert record["line"] >= 1, record
        assert record["column"] >= 1, record
        assert 10 < len(record["message"]) < 1_500, record
    # A file that a score uses is at fault in its own text.
    known = {record["file"] for record in errors}
    missing = {n for file, n in files.items() if file not in known and "/etc/passwd" not in n}
    assert not missing
    assert done.returncode == 1
    assert {path.name for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    "scores",
    few([YAML, NUMBERS, SIZES, TEXTS], [NUMBERS, SIZES, TEXTS]),
    ids=["yaml", "numbers", "sizes", "texts"],
)
def test_hostile_scores_are_refused(tmp_path: Path, scores: Mapping[str, Content]) -> None:
    refused(tmp_path, scores)


def test_commands_refuse_fifos_sockets_and_link_loops(tmp_path: Path) -> None:
    for end in ("", ".csv"):
        os.mkfifo(tmp_path / f"fifo{end}")
        (tmp_path / f"zero{end}").symlink_to("/dev/zero")
        (tmp_path / f"loop{end}").symlink_to(f"loop{end}")
        with socket.socket(socket.AF_UNIX) as listener:
            here = os.getcwd()
            os.chdir(tmp_path)  # the name of a socket must be short
            try:
                listener.bind(f"socket{end}")
            finally:
                os.chdir(here)
    refused(tmp_path, FILES)


def test_hostile_takes_are_refused(tmp_path: Path) -> None:
    for name, data in TAKES.items():
        write(tmp_path / name, data)
    with (tmp_path / "sparse.wav").open("wb") as file:
        file.write(wav(1 << 30))
        file.truncate((1 << 30) + 44)
    refused(tmp_path, {name: take(name) for name in (*TAKES, "sparse.wav")})


def test_score_using_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(HEAD + "use: [s.yaml]\n")
    done = ergon(tmp_path, "check", "s.yaml")
    assert done.returncode == 1
    assert "s.yaml:2:7: error[E302]" in done.stderr


def test_check_prints_20_of_ten_thousand_mistakes(tmp_path: Path) -> None:
    rows = "".join(f"    {i}|1 nope\n" for i in range(1, 10_001))
    (tmp_path / "s.yaml").write_text(HEAD + KEY + "parts:\n  p: |\n" + rows)
    done = ergon(tmp_path, "check", "--format", "concise", "s.yaml")
    assert done.returncode == 1
    assert done.stderr.count(": error[") == 20
    assert "9,980" in done.stderr or "9980" in done.stderr


LARGE_SCORES: Mapping[str, Callable[[], str]] = {
    "rain": lambda: strikes("for: 1000s, rate: 19Hz"),
    "times": lambda: piece("play: g", "play: g, every: 1/100, times: 200000"),
    "rows": lambda: piece(
        "parts: {p: [{at: 0, play: g}]}",
        "parts:\n  p: |\n" + "".join(f"    {i / 8} g\n" for i in range(100_000)),
    ),
    "bank": lambda: generator("BANK: {count: 2000000, M: 1g, f: 20Hz..1kHz, t60: 1s}"),
}


@pytest.mark.parametrize("name", few(LARGE_SCORES, ["rain"]))
def test_check_of_largest_allowed_scores(tmp_path: Path, name: str) -> None:
    (tmp_path / "s.yaml").write_text(LARGE_SCORES[name]())
    done = ergon(tmp_path, "check", "-q", "s.yaml")
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_render_of_hostile_score_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "law.yaml").write_text(law("__import__('os').system('touch pwned')"))
    (tmp_path / "day.yaml").write_text(piece("at: 0", "at: 1000000s"))
    for score in ("law.yaml", "day.yaml", "/dev/zero", "/", "nowhere.yaml"):
        done = ergon(tmp_path, "render", score, "-o", "out.wav")
        assert done.returncode in (1, 2), score
        assert "Traceback" not in done.stderr
        assert "error" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"law.yaml", "day.yaml"}
