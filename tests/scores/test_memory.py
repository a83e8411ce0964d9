"""What is remembered from one reading to the next changes nothing but the time it takes."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from sweep import few

from ergon.notation.text import document
from ergon.notation.text.memory import Memory
from ergon.scores.edits.texts import Texts
from ergon.scores.reading import automation, build, matter
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import Loaded, load

_LIBRARY = Path(__file__).parents[2] / "scores" / "library"
_SCORES = sorted(path.name for path in _LIBRARY.glob("*.yaml"))
_BELL = """\
ergon: 1
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}}, out: {SOX: m}}}
"""
STEPS = 16  # of each score, one after the other
_NUMBER = re.compile(r"\d+")
_STRANGE = (
    "title: again\n",
    "---\n",
    "...\n",
    "# a remark\n",
    "\n",
    "strange: 1\n",
    "  deeper: {x: 1}\n",
    "marks: {a: &here 1|1, b: *here}\n",
    "parts: *here\n",
    "%YAML 1.1\n",
    "'quoted': 1\n",
    "- item\n",
    "title: 'open\n",
    "use: [",
    "\u2028title: x\n",
)


def _changed(text: str, chance: random.Random) -> str:
    """One mistake, or one edit, of those that people and programs make."""
    lines = text.splitlines(keepends=True)
    index = chance.randrange(len(lines) + 1)
    match chance.randrange(6):
        case 0:
            return "".join([*lines[:index], chance.choice(_STRANGE), *lines[index:]])
        case 1:
            return "".join([*lines[:index], *lines[index + 1 :]])
        case 2:
            return "".join([*lines[:index], *lines[max(0, index - 1) :]])
        case 3:
            return text.replace("\n", "\r\n")
        case _:
            result = list(_NUMBER.finditer(text))
            first = chance.choice(result)
            return text[: first.start()] + str(chance.randrange(40)) + text[first.end() :]


def _loaded_values(loaded: Loaded) -> tuple[object, ...]:
    return repr(loaded.piece), loaded.diagnostics, loaded.left_out, [*loaded.files]


@pytest.mark.parametrize("name", few(_SCORES, _SCORES[::20]))
def test_memory_of_changing_score_equals_fresh_load(name: str) -> None:
    path = _LIBRARY / name
    complete = path.read_text(encoding="utf-8")
    chance = random.Random(name)
    memory, text, refused = Memory(), complete, 0
    for _ in range(STEPS):
        text = _changed(complete if chance.random() < 0.4 else text, chance)
        saved = load(path, text=text, memory=memory)
        new = load(path, text=text)
        assert _loaded_values(saved) == _loaded_values(new)
        refused += saved.has_errors
    assert 0 < refused < STEPS


@pytest.mark.slow
@pytest.mark.parametrize("name", few(["drum-machine.yaml", "workshop.yaml", "patterns.yaml"], 1))
def test_loose_memory_equals_fresh_load_except_places(name: str) -> None:
    path = _LIBRARY / name
    complete = path.read_text(encoding="utf-8")
    chance = random.Random(name)
    memory, text = Memory(is_loose=True), complete
    for _ in range(20):
        text = _changed(complete if chance.random() < 0.4 else text, chance)
        saved = load(path, text=text, memory=memory)
        new = load(path, text=text)
        if new.piece is None:
            assert _loaded_values(saved) == _loaded_values(new)
        else:
            assert saved.piece is not None
            assert digest_of(saved.piece) == digest_of(new.piece)
            for item, other in zip(saved.piece.starts, new.piece.starts, strict=True):
                assert (item and item[:20]) == (other and other[:20])


_SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 60}]
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: 200Hz, t60: 1s}}, b: {BUT: {between: [k, m], K: 900N/m}}}
    out: {SOX: m}
players: {ada: {key: k}}
parts: {ada: []}
"""


def _sections(loaded: Loaded) -> dict[str, document.Node]:
    (single, *_) = loaded.files.values()
    assert isinstance(single.root, document.Mapping)
    return {name: node for name, (_, node) in single.root.entries.items()}


def test_memory_rereads_changed_or_moved_sections() -> None:
    memory = Memory()
    before = _sections(load("s.yaml", text=_SCORE, memory=memory))
    edited = _SCORE.replace("parts: {ada: []}", "parts: {ada: []}\ngestures: {g: 0mm@0 1mm@1}")
    after = _sections(load("s.yaml", text=edited.replace("60N/m", "61N/m"), memory=memory))
    same = {name for name in before if after[name] is before[name]}
    assert same == set(before) - {"keys"}
    moved = _sections(load("s.yaml", text="# a remark\n" + edited, memory=memory))
    assert not any(moved[name] is after[name] for name in after)
    assert moved["players"].place.line == before["players"].place.line + 1


def test_memory_repeats_diagnostics_of_mistakes() -> None:
    memory = Memory()
    wrong = _SCORE.replace("f: 200Hz", "f: 200kg").replace("key: k", "key: h")
    output = [load("s.yaml", text=wrong, memory=memory).diagnostics for _ in range(3)]
    assert output[0] == output[1] == output[2] == load("s.yaml", text=wrong).diagnostics
    assert {found.code for found in output[0]} == {"E203", "E301"}
    assert load("s.yaml", text=_SCORE, memory=memory).piece is not None


def test_memory_with_two_instruments_of_one_alias() -> None:
    twice = _SCORE.replace("  bell:", "  bell: &bell").replace(
        "\nplayers", "\n  other: *bell\nplayers"
    )
    wrong = twice.replace("f: 200Hz", "f: 200Hz, K: 1N/m")
    for text in (twice, wrong):
        memory = Memory()
        for _ in range(2):
            saved = load("s.yaml", text=text, memory=memory)
            assert _loaded_values(saved) == _loaded_values(load("s.yaml", text=text))


def test_memory_of_instruments_after_reading_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A scene reads names between two whole readings, which each read a hundred modules again."""
    path = tmp_path / "score.yaml"
    path.write_text(_BELL, encoding="utf-8")
    texts = Texts.read(path)
    read: list[str] = []
    instrument = matter.make_instrument
    monkeypatch.setattr(
        matter, "make_instrument", lambda node, *rest: read.append("one") or instrument(node, *rest)
    )
    assert texts.with_text(_BELL + "seed: 2\n").load().piece is not None
    assert not read
    for _ in range(3):
        texts.names()
    assert texts.with_text(_BELL + "seed: 3\n").load().piece is not None
    assert not read
    changed = texts.with_text(_BELL.replace("440Hz", "450Hz")).load().piece
    assert changed is not None
    assert read == ["one"]


def _played(count: int) -> str:
    """Two CELs that automation leads, and strikes, `count` times each."""
    cells = "\n".join(f"      {n}: {{CEL: {{M: 2g, f: 440Hz, t60: 0.5s}}}}" for n in "mn")
    lines = "\n".join(
        f"  - {{set: bell.{'mn'[i % 2]}.K, to: x1.1, over: 1, at: {2 * i}}}" for i in range(count)
    )
    strikes = "\n".join(
        f"  s{i}: {{to: bell.m, at: {i}, every: 1, until: {i + 2}, impulse: 1mNs}}"
        for i in range(count)
    )
    head = "ergon: 1\ninstruments:\n  bell:\n    modules:\n"
    return f"{head}{cells}\n    out: {{SOX: m}}\nstrikes:\n{strikes}\nautomation:\n{lines}\n"


def test_memory_rereads_entries_of_changed_modules(monkeypatch) -> None:
    counts = {"automation": 0, "strikes": 0}
    for name, (owner, call) in {
        "automation": (automation, "build_automation"),
        "strikes": (build, "strikes"),
    }.items():
        before = getattr(owner, call)

        def counted(*args, name=name, before=before):
            counts[name] += 1
            return before(*args)

        monkeypatch.setattr(owner, call, counted)

    def read(text: str) -> tuple[int, int]:
        counts.update(automation=0, strikes=0)
        loaded = Texts("a.yaml", text, memory=memory).load()
        assert loaded.piece is not None, loaded.diagnostics
        fresh = load("a.yaml", text=text).piece
        assert fresh is not None
        assert digest_of(loaded.piece) == digest_of(fresh)
        return counts["automation"] - len(fresh.automation), counts["strikes"] - len(fresh.strikes)

    memory, text = Texts("a.yaml", "").memory, _played(20)
    assert read(text) == (20, 20)
    text += "  - {set: bell.m.K, to: x1.2, over: 1, at: 99}\n"
    assert read(text) == (1, 0)
    assert read(text.replace("ergon: 1\n", "ergon: 1\ntempo: [{at: 1|1, bpm: 90}]\n")) == (0, 0)
    assert read(text.replace("n: {CEL: {M: 2g", "n: {CEL: {M: 3g")) == (10, 0)
    assert read(text) == (10, 0)


def test_memory_forgets_unnamed_module() -> None:
    memory, base = Memory(is_loose=True), _played(9)
    texts = Texts("a.yaml", base.replace("bell.n.K", "bell.x.K"), memory=memory)
    assert "bell.x" in texts.load().diagnostics[0].message
    assert Texts("a.yaml", base, memory=memory).load().piece is not None
