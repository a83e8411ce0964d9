"""The bank in SuperCollider's server, not in real time: Klanks, and a score of OSC packets."""

from __future__ import annotations

import struct
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benches.peers import by_difference, command, program_path

SHORT, LONG = 1.0, 5.0  # seconds of sound
_AUDIO = 2  # rate of a UGen
_CONSTANT = -1  # in place of the number of a UGen
_AMPLITUDE = 1e-4


def bank(cells: Sequence[tuple[float, float]], each: int) -> Callable[[], float]:
    """Cells as (f [Hz], t60 [s]), `each` of them in a synth; a call returns the seconds that LONG -
    SHORT of sound take.
    """
    scsynth = program_path("scsynth", "supercollider-server")
    folder = tempfile.TemporaryDirectory()
    groups = [cells[i : i + each] for i in range(0, len(cells), each)]

    def run(sound: float) -> float:
        score, listened = Path(folder.name) / f"{sound}.osc", Path(folder.name) / "heard.wav"
        if not score.is_file():
            score.write_bytes(_score(groups, sound))
        to = ["-N", str(score), "_", str(listened), "44100", "WAV", "float"]
        start = time.perf_counter()
        command([scsynth, *to, "-o", "1", "-i", "0", "-m", "65536", "-D", "0"])
        return time.perf_counter() - start

    return by_difference(run, SHORT, LONG)


def _score(groups: Sequence[Sequence[tuple[float, float]]], sound: float) -> bytes:
    names = [f"bank{i}" for i in range(len(groups))]
    packets = [
        _bundle(0.0, [_message("/d_recv", _definition(name, group))])
        for name, group in zip(names, groups, strict=True)
    ]
    begun = [_message("/s_new", name, 1000 + i, 1, 0) for i, name in enumerate(names)]
    return b"".join([*packets, _bundle(0.0, begun), _bundle(sound, [_message("/sync", 0)])])


def _definition(name: str, cells: Sequence[tuple[float, float]]) -> bytes:
    """Impulse.ar(0) into a Klank into Out.ar(0), as a synth definition file of version 2."""
    constants: dict[bytes, int] = {}

    def number(value: float) -> tuple[int, int]:
        return _CONSTANT, constants.setdefault(struct.pack(">f", value), len(constants))

    klank = [(0, 0), number(1.0), number(0.0), number(1.0)]  # input; scale, offset, decay's scale
    for f, t60 in cells:
        klank += [number(f), number(_AMPLITUDE), number(t60)]
    units = [
        ("Impulse", [number(0.0), number(0.0)], 1),
        ("Klank", klank, 1),
        ("Out", [number(0.0), (1, 0)], 0),
    ]
    text = b"SCgf" + struct.pack(">ih", 2, 1) + _short(name)
    text += struct.pack(">i", len(constants)) + b"".join(constants) + struct.pack(">ii", 0, 0)
    text += struct.pack(">i", len(units))
    for kind, inputs, n_outputs in units:
        text += _short(kind) + struct.pack(">biih", _AUDIO, len(inputs), n_outputs, 0)
        text += b"".join(struct.pack(">ii", *pair) for pair in inputs)
        text += bytes([_AUDIO] * n_outputs)
    return text + struct.pack(">h", 0)


def _short(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


def _padded(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % 4)


def _message(address: str, *values: int | str | bytes) -> bytes:
    tags, body = ",", b""
    for value in values:
        if isinstance(value, int):
            tags, body = tags + "i", body + struct.pack(">i", value)
        elif isinstance(value, str):
            tags, body = tags + "s", body + _padded(value.encode() + b"\0")
        else:
            tags, body = tags + "b", body + struct.pack(">i", len(value)) + _padded(value)
    return _padded(address.encode() + b"\0") + _padded(tags.encode() + b"\0") + body


def _bundle(instant: float, messages: Sequence[bytes]) -> bytes:
    body = b"#bundle\0" + struct.pack(">Q", int(instant * 2**32))
    body += b"".join(struct.pack(">i", len(message)) + message for message in messages)
    return struct.pack(">i", len(body)) + body
