"""The text of a score that was a model of Synth-A-Modeler."""

from __future__ import annotations

import json
from collections.abc import Iterator

from ergon.common.terminal import printable
from ergon.models.sam_network import Start
from ergon.models.sam_reading import ports
from ergon.models.sam_words import RATE
from ergon.models.sam_writing import Writing, number, target


def lines(own: Writing, title: str, begin: Start, n_channels: int) -> Iterator[str]:
    """The lines of a score."""
    yield from _head(own, title)
    yield "ergon: 1"
    yield f"rates: {{audio: {RATE}Hz}}"
    yield "let:"
    for name, (text, comment, before) in own.parameters.items():
        yield from (f"  # {printable(line)}" for line in before)
        yield f"  {name}: {text}{_comment(comment)}"
    fed = [name for name in ports(own.sheet) if name in own.inputs]
    if fed:
        yield "takes:"
        for name in fed:
            yield f"  {name}: {{file: {json.dumps(own.inputs[name].file, ensure_ascii=False)}}}"
    yield "instruments:"
    yield "  model:"
    yield "    units: ca"
    yield f"    at: {RATE}Hz"
    yield "    modules:"
    for one in own.modules:
        yield from (f"      # {printable(line)}" for line in one.before)
        yield f"      {one.name}: {{{one.text}}}{_comment(one.comment)}"
    yield from (f"      # {printable(line)}" for line in own.sheet.tail)
    if own.outs:
        yield "    out:"
        yield from (f"      {out.name}: {{{out.what}}}" for out in own.outs)
    if begin.kicks:
        yield "# In its first samples the model's masses jump from 0 to where they begin, which its"
        yield "# dampers feel."
        yield "strikes:"
        for name, force in begin.kicks.items():
            kick = own.names.new(f"{own.targets[name]}_kick")
            impulse = f"{force / RATE!r}Ns"
            yield f"  {kick}: {{to: model.{target(own, name)}, at: 0s, impulse: {impulse}}}"
    if n_channels:
        yield "mix:"
        yield f"  channels: {n_channels}"
    if own.outs:
        yield "  route:"
        yield from _routes(own)
    yield "accuracy: {method: ca}"
    yield "render: {bits: float, tail: 10s}"


def _head(own: Writing, title: str) -> Iterator[str]:
    yield f"# From {printable(title) or 'a model'}, a model of Synth-A-Modeler."
    yield f"# One sample is 1/{RATE} s. M is in kg*fs*fs, K in N/m, Z in N/(m/s)*fs: the numbers of"
    yield "# the discrete network."
    free = [name for name in ports(own.sheet) if name not in own.inputs]
    if free:
        yield f"# Where a haptic device was ({_some(free)}) nothing moves."
        yield f"# --input {free[0]}=FILE.wav moves it. To play it, write a key in place of its SOL:"
        yield f"# keys: {{{own.targets[free[0]]}: {{M: 50g, K: 100N/m, Z: 1Ns/m}}}}"
    if any(out.what.startswith("SOF") and not out.is_ear for out in own.outs):
        yield "# Forces are heard one sample before the model's own."
    head = list(own.sheet.head)
    while head and not head[-1]:
        head.pop()
    if head:
        yield "#"
    yield from (f"# {printable(line)}".rstrip() for line in head)


def _some(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _routes(own: Writing) -> Iterator[str]:
    for out in own.outs:
        gain = "" if out.gain == 1.0 else f", gain: x{number(out.gain)}"
        high = "" if out.highpass is None else f", highpass: {number(out.highpass)}Hz"
        row = f"{{from: model.{out.name}, to: {out.channel}{gain}{high}}}"
        yield f"    - {row}{_comment(out.comment)}"


def _comment(text: str) -> str:
    return f"  # {printable(text)}" if text else ""
