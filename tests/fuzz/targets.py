"""The table of what is fuzzed, and what each is given."""

from __future__ import annotations

import io
import itertools
import json
import os
import random
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from benches.mutated import bases, mutated
from corrupted import corrupted
from one_bell import SCORE as BELL
from random_scores import LAWS, Score
from sessions import Stepped
from tests.fuzz import commands, sessions
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged, soup, tree
from tests.scores.test_corrupted_takes import FORMATS, MEANT, internal
from tests.scores.test_fuzz import SECTIONS, WORDS

from ergon import _core
from ergon.exchange import plan_file
from ergon.live import boards, calibration
from ergon.live.boards import BoardError
from ergon.live.datagrams import MalformedDatagramError, messages, written
from ergon.live.osc_in import OscRequestError, level_of, pressed, text_of
from ergon.notation.tables.expressions import evaluate, looks_like
from ergon.notation.text.errors import TextError, full
from ergon.notation.text.format import formatted
from ergon.notation.text.memory import Memory
from ergon.repl.wire.protocol import (
    ProtocolError,
    decode,
    decode_reply,
    decode_state,
    encode,
    parse_request,
    request_id,
)
from ergon.scores.gesture import notation
from ergon.scores.gesture.sampled import sampled
from ergon.scores.pattern import words
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import StageError, prepare, stage

LIBRARY = Path(__file__).parents[2] / "scores" / "library"


def _texts(path: str, text: str, overlay: Mapping[str, str] | None = None) -> Iterator[str]:
    """What `check` says of a score, and whether a piece that it takes can be staged."""
    memory = Memory()
    for _ in range(2):  # the second time from what is remembered of the first
        loaded = load(path, text=text, overlay=overlay, memory=memory)
        for one in loaded.diagnostics:
            yield full(one, loaded.files)
        errors = [one for one in loaded.diagnostics if one.severity == "error"]
        assert (loaded.piece is None) == bool(errors)
    if loaded.piece is None:
        return
    players = loaded.piece.players.values()
    live = {player.name: None for player in players if player.hand == "live"}
    for real in [{}, live] if live else [{}]:  # with stand-ins, then with hands as `duet` has them
        try:
            ready = prepare(loaded.piece, real)
        except StageError as error:
            yield str(error)
        else:
            yield from (one.message for one in ready.collector.finish())


LIVE = BELL.replace("hand: virtual", "hand: live, standin: lean, tick: 1kHz")

# --- scores ---------------------------------------------------------------------------------------


def _score(chance: random.Random) -> str:
    kind = chance.randrange(10)
    known = bases()
    if kind <= 2:
        text = mutated(chance.choice([*known.values(), BELL, LIVE]), chance)
        # A part that goes beyond the beginning, or hardly lasts.
        return text.replace("play: knock", f"play: knock, {chance.choice(MANNERS)}", 1)
    if kind <= 5:
        return damaged(chance.choice([*known.values(), BELL]), chance, SCORE_WORDS)
    if kind <= 7:
        return damaged(Score(chance.randrange(1 << 30)).text, chance, SCORE_WORDS)
    names = chance.sample(SECTIONS.split(), k=chance.randrange(1, 6))
    return "ergon: 1\n" + "".join(f"{name}: {tree(chance, SCORE_WORDS)}\n" for name in names)


MANNERS = (
    *("do: [shift -9999]", "do: [stretch 1e-9]", "join: 9s"),
    "{hand: live, key: k1, tick: 1kHz}",
)
_PLAIN = ("0mm@0", "1mm@1", "3bar", "-6dB", "sky.all")
SCORE_WORDS = (*WORDS.split(), *SECTIONS.split(), *_PLAIN, *MANNERS)


def _score_bytes(chance: random.Random) -> bytes:
    texts = [text.encode() for text in (*bases().values(), BELL)]
    return next(corrupted(chance.choice(texts), 1, chance.randrange(1 << 30), *texts))


def _read_score_bytes(data: bytes, folder: Path) -> Iterator[str]:
    path = folder / "score.yaml"
    path.write_bytes(data)
    loaded = load(path)
    for one in loaded.diagnostics:
        yield full(one, loaded.files)


def _read_formatted(text: str, folder: Path) -> Iterator[str]:
    once = formatted(text)
    assert formatted(once) == once, "what is formatted changes when it is formatted again"
    yield from ()


# --- expressions ----------------------------------------------------------------------------------

PIECES = (
    *("(", ")", "+", "-", "*", "/", "**", "//", " ", "1", "2.5", "1e30", "9" * 38, "1/0", "0"),
    *("400g", "1/3bar", "7st", "A3", "Bb-1", "x", "y1", "__import__", "N/m", "kN/m3", "1e-99"),
    *("..", "%", "\u2212", "\u00e9", "\n", "'", "exp(1)", "1_0", "0x1f", ".", "1.2.3", "Ns2/m2"),
)
_NAMED = {"x": evaluate("400g", {}), "y1": evaluate("A3", {})}


def _expression(chance: random.Random) -> str:
    kind = chance.randrange(20)
    if kind == 0:
        return chance.choice("(-1") * chance.randrange(1, 10_000)
    if kind == 1:
        return "*".join(chance.choice(("9" * 39, "x", "1e40")) for _ in range(chance.randrange(40)))
    return "".join(chance.choice(PIECES) for _ in range(chance.randrange(1, 40)))


def _read_expression(text: str, folder: Path) -> Iterator[str]:
    looks_like(text, _NAMED)
    yield evaluate(text, _NAMED).literal


# --- gestures and laws ----------------------------------------------------------------------------

NOTATIONS = (
    "0mm@0 smooth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/2",
    "0@0 (6@1/8 0@1/4)*4 3@2 | 0@3",
    "1cm@0 -2@1beat 0.5m@1.5 40um@+250ms 6mm@+1/4s",
    "0@0 line (6@1 throw 0@2)*2 6@5",
    "0 0mm smooth\n1/8 6mm throw\n1/2 0mm # back\n",
)
POINTS = (
    *("0@0", "6mm@1/8", "0@1/4", "3@1s", "2@+1", "1@0.5s", "-2@250ms", "900m@2", "throw", "line"),
    *("smooth", "hold", "(", ")*4", ")", "|", "0@0.6s", "5@1/1000", "throw 1@1/9999"),
)


def _gesture(chance: random.Random, depth: int = 2) -> str:
    """A gesture whose times mostly rise, in beats and in seconds."""
    said = [] if depth < 2 else ["0@0"]
    beats = seconds = 0.0
    for _ in range(chance.randrange(1, 6)):
        if depth and chance.random() < 0.2:
            said.append(f"({_gesture(chance, depth - 1)})*{chance.choice((1, 2, 3, 40))}")
            continue
        step = chance.choice((1e-7, 1e-4, 0.01, 0.125, 0.5, 1.0))
        if is_beats := chance.random() < 0.7:
            beats += step
        else:
            seconds += step
        at = f"{beats:.10g}" if is_beats else f"{seconds:.10g}s"
        x = chance.choice(("0", "6", "-3mm", "0.5m", "1e3m", "1e-12m", "900m"))
        word = chance.choice(("", "", "smooth ", "line ", "throw ", "hold "))
        said.append(f"{word}{x}@{chance.choice(('', '', '+'))}{at}")
    return " ".join(said)


def _notation(chance: random.Random) -> str:
    kind = chance.random()
    if kind < 0.2:
        return soup(chance, POINTS)
    if kind < 0.7:
        return _gesture(chance)
    return damaged(chance.choice(NOTATIONS), chance, POINTS)


def _read_notation(text: str, _: Path) -> None:
    refused: list[TextError] = []
    for read in (notation.parse, notation.parse_table):
        try:
            points = read(text).points
            last = points[-1].at
            if last.beats + last.seconds < 5.0:  # a longer gesture is no other
                sampled(points, 0.5, 1000.0)
        except TextError as error:
            refused.append(error)
    assert all(0 <= error.offset <= len(text) and error.length >= 0 for error in refused)
    if len(refused) == 2:
        raise refused[0]


PLAYS = (
    "lean every 8 times 2 do scale 0.5, mirror until C layer",
    "knock at B+1bar every 1/2 touch tracked do jitter 4ms 0.2mm, stretch 2, shift -1/8",
)


def _plays(chance: random.Random) -> str:
    known = [*words.OPTIONS, *words.ARITY, "lean", ",", "do", "1/8", "2bar", "#", "C-1"]
    if chance.random() < 0.5:
        return soup(chance, known)
    return damaged(chance.choice(PLAYS), chance, known)


LAW_TEXTS = tuple(law.partition(",")[0] for law in LAWS.values())
_LAW_WORDS = (
    "d v k q w + - * / ** ( ) , < >= == . if [ ] ^ max min abs sqrt sign exp tanh where clip"
)
LAW_WORDS = (*_LAW_WORDS.split(), "1e308", "2.5", "3N/m")


def _expression(chance: random.Random, depth: int = 4) -> str:
    """A law that mostly has a meaning."""
    kind = chance.randrange(6) if depth else 0
    if kind <= 1:
        return chance.choice(("d", "d", "v", "k", "q", "w", "f", "0", "1e308", "1e-308", "2.5"))
    left, right = (_expression(chance, depth - 1) for _ in range(2))
    if kind == 2:
        return f"{chance.choice(('abs', 'sqrt', 'sign', 'exp', 'tanh', '-'))}({left})"
    if kind == 3:
        return f"{chance.choice(('max', 'min'))}({left}, {right})"
    return f"({left}){chance.choice(('+', '-', '*', '/', '**', '<', '>='))}({right})"


def _law(chance: random.Random) -> tuple[str, str | None, dict[str, float], float]:
    def text() -> str:
        kind = chance.random()
        if kind < 0.2:
            return soup(chance, LAW_WORDS, between="")
        if kind < 0.7:
            return _expression(chance)
        return damaged(chance.choice(LAW_TEXTS), chance, LAW_WORDS)

    edges = (0.0, 1.0, -1.0, 1e308, 5e-324, float("inf"), float("nan"), 200.0)
    usual = (200.0,) * 20
    constants = {name: chance.choice((*usual, *edges)) for name in "kqwf"}
    damping = text() if chance.random() < 0.2 else None
    return text(), damping, constants, chance.choice((*usual, *edges))


def _read_law(case: tuple[str, str | None, dict[str, float], float], _: Path) -> None:
    expression, damping, constants, reach = case
    law = _core.Law(expression, damping, constants, reach=reach)
    for x in (0.0, 1e-3, -1e308, float("nan")):
        law.force(x, -x)
        law.potential(x)
    law.rows()


# --- files ----------------------------------------------------------------------------------------


def _take(suffix: str) -> Target:
    others = [data for every in FORMATS.values() for data in every]

    def case(chance: random.Random) -> bytes:
        whole = chance.choice(FORMATS[suffix])
        return next(corrupted(whole, 1, chance.randrange(1 << 30), *others))

    return Target(f"take{suffix}", case, partial_take(suffix), MEANT, 80)


def partial_take(suffix: str) -> Any:
    """A reader of takes in a format."""
    from ergon.cli.console import Console
    from ergon.cli.take_info import take as told

    def read(data: bytes, folder: Path) -> list[str]:
        import contextlib

        path = folder / f"hand{suffix}"
        path.write_bytes(data)
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            found = internal(path, lambda path: told(Console(json=True), path))
        assert not found, found
        return [said.getvalue()]

    return read


@cache
def _bell() -> Any:
    loaded = load("bell.yaml", text=BELL)
    assert loaded.piece is not None
    return loaded.piece


@cache
def _plan_text() -> str:
    plan = stage(_bell(), planned=True).plan
    assert plan is not None
    return plan_file.text(plan.choices(), plan.hash, budget={"error": -60.0})


PLAN_WORDS = (
    "[",
    "]",
    "{",
    "}",
    ",",
    '"choices":',
    '"ergon_plan": 1',
    '"budget":',
    "true",
    "null",
    "4294967295",
)


def _plan(chance: random.Random) -> str:
    if chance.random() < 0.3:
        choices = [
            [chance.choice((1, 2, 0, 1 << 31, (1 << 32) - 1)) for _ in range(3)]
            + [[[chance.randrange(4) for _ in range(chance.randrange(4))] for _ in range(2)]]
            for _ in range(chance.randrange(4))
        ]
        return plan_file.text(choices, "0")  # type: ignore[arg-type]
    return damaged(_plan_text(), chance, PLAN_WORDS)


def _read_plan(text: str, folder: Path) -> Iterator[str]:
    path = folder / "plan.json"
    path.write_bytes(text.encode(errors="replace"))
    choices = plan_file.read(path).choices
    try:
        stage(_bell(), planned=True, pins=choices)
    except StageError as error:
        yield str(error)


class _Records:
    """A store of trials that gives the same records again and again, whatever is asked for."""

    def __init__(self, records: list[_core.TrialRecord]) -> None:
        self._records = itertools.cycle([*records, None])

    def get(self, key: str) -> _core.TrialRecord | None:
        return next(self._records)

    def put(self, key: str, record: _core.TrialRecord) -> None:
        pass

    def forget(self) -> None:
        pass


def _trials(chance: random.Random) -> list[_core.TrialRecord]:
    """Records that a stranger may have left: any numbers, as many as there are or others."""
    sizes = (0.0, -1.0, -60.0, 1e-3, 0.5, 1e300, None, None)
    counts = (0, 1, 2, 3, 4, 8, 64, 1 << 31, (1 << 32) - 1)
    return [
        _core.TrialRecord(
            [chance.choice(sizes) for _ in range(chance.choice((0, 3, 9, 10, 11)))],
            [[0], *([chance.choice(counts) for _ in range(chance.choice((1, 3)))] for _ in "ab")][
                : chance.randrange(4)
            ],
            chance.choice((None, None, "it is not linear", "why")),
        )
        for _ in range(chance.randint(1, 5))
    ]


def _read_trials(records: list[_core.TrialRecord], _: Path) -> None:
    made = stage(_bell(), planned=True, store=_Records(records)).plan
    assert made is not None
    made.rows()


DEVICES = """\
# mine
[devices]
tgr0 = "frame:/dev/ttyACM0"
left = "haply:127.0.0.1:10001?id=A14"

[calibration."frame:/dev/ttyACM0#0"]
sign = 1
zero = 0.001
gain = 1.02
range = [-0.01, 0.01]
force_max = 10.0

[calibration."haply:A14#1"]
sign = -1
zero = 0.0
gain = -1.0
range = [-0.1, 0.1]
force_max = 3
"""
DEVICE_WORDS = ("[calibration]", "[[devices]]", "sign = true", "inf", "nan", "[[1]]", '"', "'''")


def _read_devices(text: str, folder: Path) -> None:
    before = os.environ.get("XDG_CONFIG_HOME")
    os.environ["XDG_CONFIG_HOME"] = str(folder)
    path = folder / "ergon" / "devices.toml"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(text.encode(errors="surrogatepass"))
    axis = calibration.Axis(1, 0.0, 1.0, (-0.01, 0.01), 5.0)
    try:
        urls = [*boards.names().values(), "frame:/dev/ttyACM0", "haply:127.0.0.1:1?id=A14"]
        for url in urls[:6]:
            calibration.known(url)
            calibration.certain(url)
        calibration.remember("frame:/dev/ttyACM0", 0, axis)
        assert calibration.known("frame:/dev/ttyACM0")[0] == axis
    finally:
        if before is None:
            del os.environ["XDG_CONFIG_HOME"]
        else:
            os.environ["XDG_CONFIG_HOME"] = before


CALIBRATED = BELL.replace("M: 400g, K: 60N/m, Z: 1.2Ns/m", "calib: other.yaml")
LAID_OUT = BELL.replace("mix: {channels: 2", "mix: {layout: other.yaml, channels: 2")


def _beside(file: str) -> Any:
    text = (LIBRARY / file).read_text("utf-8")
    known = (
        "speakers:",
        "[0m, 1m]",
        "[",
        "]",
        "M: 1g",
        "K: 1N/m",
        "Z:",
        "title:",
        "ergon: 1",
        "- ",
    )
    return lambda chance: damaged(text, chance, known)


def _read_beside(score: str) -> Any:
    return lambda text, folder: _texts(
        str(folder / "s.yaml"), score, {str(folder / "other.yaml"): text}
    )


# --- what comes over sockets ----------------------------------------------------------------------

REQUESTS = tuple(
    json.dumps(fields)
    for fields in (
        {"id": 1, "do": "submit", "text": "tempo 72", "releases": False},
        {"id": "a", "do": "complete", "line": "set be", "cursor": 4},
        {"id": 2, "is": dict(taken=True, text="ok", lines=[], leaves=False, **{"try": None})},
        {
            "id": 3,
            "is": dict(
                bar=1, beat=1.5, tempo=60.0, playing=[["ada", "knock"]], load=0.1, late=0,
                level=None, quant="1bar", recording=None, panicked=False,
            ),
        },
    )
)  # fmt: skip
WIRE_WORDS = (
    '"id":',
    '"do":',
    '"is":',
    '"cancel"',
    "{",
    "}",
    "[",
    "]",
    "NaN",
    "1e999",
    "true",
    ",",
)


def _wire(chance: random.Random) -> bytes:
    if chance.random() < 0.01:
        return chance.choice((b"[", b'{"a":')) * 100_000
    if chance.random() < 0.3:
        return soup(chance, WIRE_WORDS).encode()
    return damaged(chance.choice(REQUESTS), chance, WIRE_WORDS).encode(errors="surrogatepass")


def _read_wire(line: bytes, _: Path) -> None:
    fields = decode(line)
    for read in (decode_reply, decode_state):
        try:
            read(fields.get("is"))
        except ProtocolError:
            continue
    encode(id=request_id(fields))
    _, given = parse_request(fields)
    encode(**{"id": 1, "is": given})


def _osc(chance: random.Random) -> bytes:
    def message() -> bytes:
        arguments = [
            chance.choice((1, -1, 1e30, "a", b"xyz", True)) for _ in range(chance.randrange(3))
        ]
        return written(chance.choice(("/ergon/gain", "/ergon/cmd", "/", "/ergon/stop")), arguments)

    data = message()
    for _ in range(chance.choice((0, 0, 1, 3, 10))):
        parts = [data, message()]
        data = b"#bundle\0" + bytes(8) + b"".join(struct.pack(">I", len(p)) + p for p in parts)
    if chance.random() < 0.9:
        data = next(corrupted(data, 1, chance.randrange(1 << 30), message()))
    return data


def _read_osc(datagram: bytes, _: Path) -> list[str]:
    said = []
    asks = (level_of(lambda ratio: None), pressed(lambda: None), text_of(lambda line: None))
    for _address, arguments in messages(datagram):
        for ask in asks:
            try:
                ask(arguments)
            except OscRequestError as error:
                said.append(str(error))
    return said


def _midi(chance: random.Random) -> list[bytes]:
    """Packets of a MIDI port, most of them nearly right."""

    def packet() -> bytes:
        status = chance.choice(
            (0x90, 0x80, 0xB0, 0xF2, 0xF8, 0xFA, 0xFB, 0xFC, chance.randrange(256))
        )
        data = bytes([status, chance.randrange(256), chance.choice((0, 1, 64, 127, 200))])
        return data[: chance.choice((0, 1, 1, 2, 3, 3, 3, 3))] + chance.choice((b"", b"", b"\0"))

    return [packet() for _ in range(chance.randrange(1, 40))]


def _read_midi(packets: list[bytes], folder: Path) -> Iterator[str]:
    """Send them to a session in which much is mapped."""
    stepped = Stepped(BELL, folder, journal=False, keeps=False)
    try:
        for line in MAPS:
            assert stepped.type(line).taken, line
        stepped.run(0.01)
        for packet in packets:
            stepped.session.midi.receive(packet, 0.0)
            stepped.run(0.004)
        yield from stepped.session.messages()
    finally:
        stepped.session.close()


MAPS = (
    "map cc 1 bell.m.f 10Hz..30000Hz now",
    "map cc 64 gain bell -400dB..24dB now",
    "map cc 127 k1.M 1mg..1kg now",
    "map note 0..127 bell.m -1Ns..1Ns now",
    "map note 60 bell.m 1mNs now",
)


def _typed(chance: random.Random) -> str:
    from tests.repl.test_repl_hostile import hostile

    return hostile(chance)


def _read_typed(line: str, _: Path) -> None:
    from tests.repl.test_repl_hostile import holds

    holds(line)


TARGETS = (
    Target("scores", _score, lambda text, folder: _texts("s.yaml", text), (), 30, limit=30.0),
    Target("score bytes", _score_bytes, _read_score_bytes, (), 40, limit=30.0),
    Target("commands", commands.case, commands.read, (), 1, 20_000, limit=60.0),
    Target("format", _score, _read_formatted, (TextError,), 30),
    Target("notation", _notation, _read_notation, (TextError,), 2000),
    Target("expressions", _expression, _read_expression, (TextError,), 3000, limit=0.5),
    Target("plays", _plays, lambda text, _: words.parse(text) and None, (TextError,), 2000),
    Target("laws", _law, _read_law, (_core.EngineError,), 1000),
    *(_take(suffix) for suffix in FORMATS),
    Target("plans", _plan, _read_plan, (plan_file.NotPlanError,), 150),
    Target("trial records", _trials, _read_trials, (), 3, 5_000),
    Target("devices.toml", lambda chance: damaged(DEVICES, chance, DEVICE_WORDS), _read_devices,
           (BoardError,), 300),
    Target("calibrations", _beside("calib/crm-key-03.yaml"), _read_beside(CALIBRATED), (), 60),
    Target("layouts", _beside("layouts/stereo.yaml"), _read_beside(LAID_OUT), (), 60),
    Target("socket lines", _wire, _read_wire, (ProtocolError,), 3000),
    Target("OSC packets", _osc, _read_osc, (MalformedDatagramError,), 2000, is_silent=True),
    Target("MIDI packets", _midi, _read_midi, (), 30, 20_000),
    Target("journals", sessions.journal, sessions.read_journal, (), 20, limit=30.0),
    Target("sessions", sessions.typed, sessions.read_typed, (), 20, limit=30.0),
    Target("typed lines", _typed, _read_typed, (), 500),
)  # fmt: skip
BY_NAME = {target.name: target for target in TARGETS}
