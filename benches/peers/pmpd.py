"""Masses and springs of pmpd in Pure Data's batch mode: objects, and messages between them.

A mass begins at rest, half a step of its weight later than in our scene. The relative difference
is one over the number of frames.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benches.peers import Missing, command, program_path
from benches.sides import Floats

_OBJECTS = Path("/usr/lib/pd/extra/pmpd")
_SEEN = 16  # masses whose places are told
# One frame: springs pull by the positions of masses, then masses move.
_FRAME = "\\; ties bang \\; free force3D 0 0 {weight!r} \\; free bang"


class Program:
    """Pure Data and the objects of pmpd; raises Missing."""

    def __init__(self) -> None:
        """Look for both."""
        self._pd = program_path("pd", "puredata-core")
        if not _OBJECTS.is_dir():
            raise Missing(f"{_OBJECTS} is not here (Debian: pd-pmpd)")
        self._folder = tempfile.TemporaryDirectory()

    def scene(
        self, lines: Iterable[str], warm: int, n_frames: int
    ) -> Callable[[], tuple[float, Floats]]:
        """A call that returns the CPU time of frames after the warm-up frames [s], and the places
        of masses.

        Lines are those of miPhysics' driver; places are (n, 3) [m], NaN for a mass that does not
        report its place.
        """
        file = Path(self._folder.name) / "scene.pd"
        masses, springs, gravity = _read(lines)
        file.write_text("\n".join(_patch(masses, springs, gravity, warm, n_frames)) + "\n")

        def run() -> tuple[float, Floats]:
            quiet = ["-batch", "-nogui", "-noaudio", "-nomidi", "-noprefs"]
            output = command([self._pd, *quiet, "-stderr", "-path", str(_OBJECTS), str(file)])
            places = np.full((len(masses), 3), np.nan)
            seconds = np.nan
            for line in output.splitlines():
                name, _, rest = line.partition(": ")
                if name == "took":
                    seconds = float(rest) * 1e-3
                elif name.startswith("at"):
                    places[int(name[2:])] = [float(word) for word in rest.split()[1:]]
            return seconds, places

        return run


_Numbers = tuple[float, ...]


def _read(lines: Iterable[str]) -> tuple[list[_Numbers], list[_Numbers], float]:
    """Masses (m; place), springs (ends, K, Z, rest), and gravity, in units of a frame."""
    masses, springs, gravity = [], [], 0.0
    for line in lines:
        word, *numbers = line.split()
        item = tuple(float(number) for number in numbers)
        if word == "mass":
            masses.append(item[:4])
        elif word == "spring":
            springs.append(item)
        else:
            assert word == "gravity", line
            (gravity,) = item
    return masses, springs, gravity


def _patch(
    masses: Sequence[_Numbers],
    springs: Sequence[_Numbers],
    gravity: float,
    warm: int,
    n_frames: int,
) -> Iterator[str]:
    """A patch that loads, plays its frames, reports their time, and ends."""
    (heavy,) = {mass[0] for mass in masses if mass[0]}
    yield "#N canvas 0 0 400 300 10;"
    for m, *place in masses:
        yield _object("mass3D", "free" if m else "held", m or 1.0, *place)
    for _, _, k, z, rest in springs:
        yield _object("link3D", "ties", rest, k, z)
    first = len(masses) + len(springs)
    probes = np.linspace(1, len(masses) - 1, _SEEN).astype(int)
    begin, until, frame, clock, end, shown = range(first, first + 6)
    # The actions of one bang, the last outlet first.
    yield _object("t", *"bbbbbbb")
    yield _object("until")
    yield f"#X msg 0 0 {_FRAME.format(weight=-heavy * gravity)};"
    yield _object("cputime")
    yield _object("print", "took")
    yield _object("t", *"bf")
    control = first + 6
    yield _object("loadbang")
    yield "#X msg 0 0 \\; free reset \\; held reset \\; ties resetF;"
    yield f"#X msg 0 0 {warm};"
    yield f"#X msg 0 0 {n_frames - 1};"
    yield "#X msg 0 0 1;"
    yield "#X msg 0 0 \\; pd quit;"
    gates = control + 6
    for probe in probes:
        yield _object("spigot")
        yield _object("print", f"at{probe}")
    for spring, (a, b, *_) in enumerate(springs, len(masses)):
        yield from (_cord(int(a), 0, spring, 0), _cord(int(b), 0, spring, 1))
        yield from (_cord(spring, 0, int(a), 0), _cord(spring, 1, int(b), 0))
    loaded, reset, warmed, limit, last, leave = range(control, gates)
    yield _cord(loaded, 0, begin, 0)
    # The last frame reports places, and its time is counted too.
    for outlet, (what, inlet) in enumerate(
        [(leave, 0), (clock, 1), (last, 0), (limit, 0), (clock, 0), (warmed, 0), (reset, 0)]
    ):
        yield _cord(begin, outlet, what, inlet)
    yield from (_cord(count, 0, until, 0) for count in (warmed, limit))
    yield from (_cord(until, 0, frame, 0), _cord(clock, 0, end, 0), _cord(last, 0, shown, 0))
    yield _cord(shown, 0, frame, 0)
    for index, probe in enumerate(probes):
        gate = gates + 2 * index
        yield from (_cord(int(probe), 0, gate, 0), _cord(gate, 0, gate + 1, 0))
        yield _cord(shown, 1, gate, 1)


def _object(name: str, *arguments: object) -> str:
    words = (repr(one) if isinstance(one, float) else str(one) for one in arguments)
    return f"#X obj 0 0 {' '.join([name, *words])};"


def _cord(source: int, outlet: int, target: int, inlet: int) -> str:
    return f"#X connect {source} {outlet} {target} {inlet};"
