"""The text of a score with one instrument `model` under `units: ca`, which all dialects produce."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ergon.common.terminal import printable

RATE = 44_100  # [Hz] of a score that has the numbers of a model without a rate of its own


@dataclass(frozen=True, slots=True)
class Line:
    """A name and its value, with comments before the line and at its end."""

    name: str
    value_text: str
    comment: str = ""
    comments_before: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """The word that a module begins with."""
        return self.value_text.lstrip("{").partition(":")[0]

    def score_lines(self, indent: str) -> Iterator[str]:
        """The line of a score, after its comments."""
        yield from (f"{indent}# {printable(line)}" for line in self.comments_before)
        yield f"{indent}{self.name}: {self.value_text}{trailing_comment(self.comment)}"


@dataclass(frozen=True, slots=True)
class Input:
    """The source of an input, a file or OSC: its first samples, and the least and most of all
    samples.

    `trim` is the part of the file that is used, written as for a take. OSC has no `file`.
    """

    file: str | None
    first_sample: float
    second_sample: float = 0.0
    sample_min: float = 0.0
    sample_max: float = 0.0
    n_frames: int = 0
    trim: str = ""

    @property
    def start_field_text(self) -> str:
        """When an ENX or ENF that this input drives begins, as a further field."""
        return "" if self.file is None else ", at: 0s"

    def take(self, name: str, unit: str) -> Line:
        """The input as a take; a value of 1 by OSC is 1 of `unit`."""
        if self.file is None:
            comment = f"/ergon/input/{name} VALUE, from -1 to 1"
            return Line(name, f"{{input: osc, gain: 1{unit}}}", comment)
        trim = f", trim: {self.trim}" if self.trim else ""
        return Line(name, f"{{file: {json.dumps(self.file, ensure_ascii=False)}{trim}}}")


@dataclass(frozen=True, slots=True)
class Output:
    """An output of the instrument, and the channel on which it is heard.

    `options` are those of its route, with the comma before each.
    """

    name: str
    source: str
    channel: int
    options: str = ""
    comment: str = ""


@dataclass(slots=True)
class Page:
    """The content of a score, in the order in which it is written."""

    header: Iterable[str]
    modules: Iterable[Line]
    outputs: Sequence[Output]
    n_channels: int = 0  # at least, where one of them is silent
    parameters: Iterable[Line] = ()
    inputs: Mapping[str, Input] = field(default_factory=dict)  # by their names
    force_inputs: Collection[str] = ()  # the inputs that are forces
    module_comments: Iterable[str] = ()  # comments behind the modules
    strike_comments: Iterable[str] = ()  # comments
    strikes: Sequence[Line] = ()

    def text(self) -> str:
        """The text."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        yield from (f"# {printable(line)}".rstrip() for line in self.header)
        yield "ergon: 1"
        yield f"rates: {{audio: {RATE}Hz}}"
        yield from _block("let:", self.parameters)
        takes = (
            (name, source, "N" if name in self.force_inputs else "m")
            for name, source in self.inputs.items()
        )
        yield from _block("takes:", (source.take(name, unit) for name, source, unit in takes))
        yield "instruments:"
        yield "  model:"
        yield "    units: ca"
        yield f"    at: {RATE}Hz"
        yield from _block("    modules:", self.modules)
        yield from (f"      # {printable(line)}" for line in self.module_comments)
        yield from _block("    out:", (Line(out.name, f"{{{out.source}}}") for out in self.outputs))
        yield from (f"# {line}" for line in self.strike_comments if self.strikes)
        yield from _block("strikes:", self.strikes)
        n_channels = max([self.n_channels, *(out.channel for out in self.outputs)])
        if n_channels:
            yield "mix:"
            yield f"  channels: {n_channels}"
        if self.outputs:
            yield "  route:"
        for out in self.outputs:
            row = f"{{from: model.{out.name}, to: {out.channel}{out.options}}}"
            yield f"    - {row}{trailing_comment(out.comment)}"
        yield "accuracy: {method: ca, guard: off}"
        yield "render: {bits: float, tail: 10s}"


# The range of OSC: at rest until the first value, and within full scale.
OSC = Input(None, 0.0, sample_min=-1.0, sample_max=1.0)


def gain_option(factor: float) -> str:
    """A factor as an option of a route; nothing where it is 1."""
    return "" if factor == 1.0 else f", gain: x{number_text(factor)}"


def number_text(number: float) -> str:
    """A number without a needless `.0`."""
    return repr(int(number)) if number == int(number) and abs(number) < 1e15 else repr(number)


def trailing_comment(comment: str) -> str:
    """A comment at the end of a line; nothing where it is empty."""
    return f"  # {printable(comment)}" if comment else ""


def _block(title: str, lines: Iterable[Line]) -> Iterator[str]:
    """A title and its lines; nothing where there are none."""
    indent = " " * (len(title) - len(title.lstrip()) + 2)
    for line_index, line in enumerate(lines):
        if line_index == 0:
            yield title
        yield from line.score_lines(indent)
