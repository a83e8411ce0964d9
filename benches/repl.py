"""The time until lines typed into sessions are answered."""

from __future__ import annotations

import gc
import tempfile
import time
from contextlib import closing
from pathlib import Path

from benches.measure import Row
from ergon.live.perform import PlaybackConfig
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.live import LiveEngine
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import Stage

_LIBRARY = Path(__file__).parent.parent / "scores" / "library"
LINES = (
    "{a} plays {g} every 1 now",
    "{g} = 0@0 smooth 5@1/8 smooth 0@1/2",
    "{b} plays {g} every 2 do scale 0.9",
    "tempo 236",
    "gain {i} -3dB",
    "{a} do scale 0.9",
    "rest {b}",
    "undo",
    "{b} plays {g} every 1/2 now",
    "? {g}",
)
_APART = 1.1  # [s]: more than a bar at 240 bpm, so that a line waits alone
_MARGIN = 0.006  # [s] as `ergon repl` has it
_TICK = 64  # frames
_LOOK = 40  # ticks between two looks of the session at its engine


# Sequences, strikes, automation and scenes; `verse` and `refrain` are kept before.
PATTERNS = (
    "p0 plays knock (knock knock) ~ every 1/2",
    "p1 plays choose knock ~ every 1 chance 0.6 every 4th do mirror",
    "rain strikes bells.m3 euclid 5 8 impulse 0.1mNs..0.3mNs",
    "bells.m1 notes A3 C4 E4 euclid 5 8",
    "lfo bells.m6.K 0.8..1.2 period 4bar",
    "lfo bells.m6.K off",
    "scene verse",
    "scene refrain over 1bar",
    "p2 plays knock euclid 3 8 rotate 2",
    "rest rain",
)


def repl() -> list[Row]:
    """Time from Enter to the answer, with everything checked and built: a hundred modules, and the
    bundled duet.
    """
    names = {"a": "p0", "b": "p1", "g": "knock", "i": "bells"}
    small = _answered("100 modules, 4 players", hundred(), names)
    names = {"a": "ada", "b": "ada", "g": "soft", "i": "gong"}
    duet = (_LIBRARY / "duet.yaml").read_text(encoding="utf-8")
    patterns = _answered_by_work(hundred())
    return [small, patterns, _answered("the bundled duet", duet, names, _LIBRARY)]


def _answered_by_work(text: str) -> Row:
    """Patterns and scenes, in CPU time of the line, so that other programs do not count."""
    engines: list[SteppedEngine] = []

    def begin(stage: Stage) -> SteppedEngine:
        engines.append(SteppedEngine(stage, tick_frames=_TICK, highpass=None))
        return engines[0]

    def passes(seconds: float) -> None:
        for _ in range(int(seconds * session.schedule.rate / (_LOOK * _TICK))):
            session.do_once()
            _ = session.scope  # as the session's own thread does between lines
            engines[0].process(_LOOK * _TICK)

    taken = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "typed.yaml"
        path.write_text(text, encoding="utf-8")
        texts = Texts.read(path)
        version = Version(0, "", texts, piece_of(texts))
        with closing(Session(version, begin, margin=0.0)) as session:
            for line in ("play", "tempo 240 now", "p0 plays knock every 1"):
                session.submit(line)
            passes(5.0)
            for line in ("keep 2bar as verse", "p1 plays knock every 2", "set bells.b0.K x1.2"):
                session.submit(line)
            passes(5.0)
            session.submit("keep 4bar as refrain")
            gc.collect()
            gc.freeze()
            for line in PATTERNS * 2:
                begun = time.thread_time()
                reply = session.submit(line)
                taken.append(1e3 * (time.thread_time() - begun))
                assert reply.taken, f"{line}: {reply.text}"
                passes(_APART)
            gc.unfreeze()
    taken.sort()
    p50, p95 = taken[len(taken) // 2], taken[int(0.95 * len(taken))]
    return Row(
        "a pattern or a scene typed into 100 modules",
        f"answered in {p50:.1f} ms of CPU time, 95 % within {p95:.1f} ms",
        "target: 20 ms at 95 %",
        None,
        "by CPU time",
        {"p50_ms": p50, "p95_ms": p95},
    )


def _answered(what: str, text: str, names: dict[str, str], folder: Path | None = None) -> Row:
    with tempfile.TemporaryDirectory() as temporary:
        path = (folder or Path(temporary)) / "typed.yaml"
        texts = Texts(str(path), text).complete()
        version = Version(0, "", texts, piece_of(texts))
        taken = []
        order = PlaybackConfig(audio="null", gain=1.0)
        make = lambda stage: LiveEngine(stage, order)  # noqa: E731 - one word
        with closing(Session(version, make, margin=_MARGIN)) as session:
            gc.collect()
            gc.freeze()
            session.run()
            for line in ("play", "tempo 240 now"):
                session.submit(line)
            time.sleep(_APART)
            for _ in range(6):
                for line in LINES:
                    message = line.format(**names)
                    begin = time.perf_counter()
                    reply = session.submit(message)
                    taken.append(1e3 * (time.perf_counter() - begin))
                    assert reply.taken, f"{message}: {reply.text}"
                    time.sleep(_APART)
            late = session.state().late
        gc.unfreeze()
    taken.sort()
    p50, p95 = taken[len(taken) // 2], taken[int(0.95 * len(taken))]
    return Row(
        f"a line typed into {what}",
        f"answered in {p50:.1f} ms, 95 % within {p95:.1f} ms; {late} late ticks",
        "target: 20 ms at 95 %, of 100 modules",
        None,
        "by the clock",
        {"p50_ms": p50, "p95_ms": p95, "late": late},
    )


def hundred() -> str:
    """Fifty bells, fifty contacts, four hands."""
    cells = [f"      m{i}: {{CEL: {{M: 2g, f: {200 + 7 * i}Hz, t60: 1s}}}}" for i in range(50)]
    contacts = [
        f"      b{i}: {{BUT: {{between: [k{i % 4}, m{i}], K: 900N/m, gap: 1mm}}}}"
        for i in range(50)
    ]
    keys = [f"  k{i}: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}" for i in range(4)]
    players = [f"  p{i}: {{key: k{i}}}" for i in range(4)]
    return "\n".join(
        [
            "ergon: 1",
            "tempo: [{at: 1|1, bpm: 60}]",
            "keys:",
            *keys,
            "instruments:",
            "  bells:",
            "    modules:",
            *cells,
            *contacts,
            "    out: {SOX: m0}",
            "gestures:",
            "  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2",
            "players:",
            *players,
            "parts: {p0: []}",
            "",
        ]
    )
