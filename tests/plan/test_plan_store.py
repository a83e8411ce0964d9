"""What trials found, kept from one run to the next: the same sound, and nothing to rely on."""

import os
import re
from pathlib import Path

import pytest
from commands import records
from sweep import few

from ergon._core import TrialRecord
from ergon.cli import app
from ergon.exchange import cache_folder, plan_store
from ergon.exchange.plan_store import PlanStore, user_store
from ergon.exchange.wave import hash_samples

Capture = pytest.CaptureFixture[str]

# Modes with some left out, a mesh, and an island by hand: each with something that a pilot tells.
SCORE = """\
ergon: 1
accuracy: {error: -50dB}
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  wire: {modules: {s: {STRING: {masses: 24, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.17}}
  gong:
    modules: {p: {PLATE: {shape: hex, radius: 2, M: 50g, f: 900Hz, t60: 1s, hardening: 1e10}}}
    out: {SOX: p.centre}
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
strikes:
  a: {to: [wire.s.3], at: 0.1s, impulse: 1mNs}
  c: {to: [gong.p.centre], at: 0.05s, impulse: 3mNs}
render: {tail: 0.1s, bits: float}
"""
# The last of the three alone.
BELL = re.sub(r"  wire:.*(?=  bell:)|strikes:.*(?=render:)", "", SCORE, flags=re.DOTALL)


@pytest.fixture(autouse=True)
def plans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("ERGON_CACHE", "on")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("a.yaml").write_text(SCORE)
    return tmp_path / "cache" / "ergon" / "plans"


def printed_plan(capsys: Capture, *options: str) -> tuple[list[dict], bool]:
    """The rows of the plan, and whether it was kept from before."""
    assert app.run(["plan", "a.yaml", "--json", *options]) == 0
    *rows, plan = records(capsys)
    return [*rows, plan["hash"]], plan["kept"]


def sound() -> str:
    assert app.run(["render", "a.yaml", "-o", "a.wav", "-f"]) == 0
    return hash_samples(Path("a.wav"))


def test_plan_store_same_table_and_sound(capsys: Capture, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ERGON_CACHE", "off")
    fresh, is_kept = printed_plan(capsys)
    assert not is_kept
    by_fresh = sound()
    monkeypatch.setenv("ERGON_CACHE", "on")
    capsys.readouterr()
    assert printed_plan(capsys) == (fresh, False)
    assert printed_plan(capsys) == (fresh, True)
    assert sound() == by_fresh
    # What only a pilot knows is among it.
    assert any(row["error_db"] is not None for row in fresh[:-1])
    assert any(row["left_out_db"] is not None for row in fresh[:-1])
    assert any(row["because"] is not None for row in fresh[:-1])
    capsys.readouterr()
    assert app.run(["plan", "a.yaml"]) == 0
    assert "s (from the cache); plan sha256" in capsys.readouterr().out


# What is edited, and whether all that trials found before still holds.
EDITS = [
    ("4g, f", "4.000000001g, f", True),  # the wire is linear: no trial
    ("M: 50g", "M: 51g", False),
    ("6mm", "6.1mm", False),
    ("at: 0.05s", "at: 0.06s", False),
    ("tail: 0.1s", "tail: 0.2s", True),
]


@pytest.mark.parametrize(("old", "new", "is_known"), few(EDITS, EDITS[::4]))
def test_plan_store_key_depends_on_score_fields(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, old: str, new: str, is_known: bool
):
    assert not printed_plan(capsys)[1]
    Path("a.yaml").write_text(SCORE.replace(old, new))
    edited, is_kept = printed_plan(capsys)
    assert is_kept == is_known
    monkeypatch.setenv("ERGON_CACHE", "off")
    assert printed_plan(capsys) == (edited, False)


def test_plan_store_key_depends_on_budget(capsys: Capture):
    assert not printed_plan(capsys)[1]
    assert not printed_plan(capsys, "--error", "-49dB")[1]


def test_plan_store_key_depends_on_version(capsys: Capture, monkeypatch: pytest.MonkeyPatch):
    assert not printed_plan(capsys)[1]
    monkeypatch.setattr(cache_folder, "_engine_hash", lambda: "another")
    assert not printed_plan(capsys)[1]


SPOILT = [
    lambda text: "",
    lambda text: text[: len(text) // 2],
    lambda text: "[" * 100_000,
    lambda text: "\x00\xff",
    lambda text: text.replace('"key":"', '"key":"0'),
    lambda text: text.replace('"counts":[[', '"counts":[[1'),
    lambda text: text.replace('"hash":"', '"hash":"0'),
    lambda text: text.replace('"ergon_trial":2', '"ergon_trial":3'),
    lambda text: text.replace('"numbers":[', '"numbers":[NaN,'),
    lambda text: text.replace('"numbers":[', '"numbers":["a",'),
    lambda text: text.replace('"counts":[', '"counts":[[-1],'),
    lambda text: text.replace('"counts":[', '"counts":[[1,1,0],[7],'),
    lambda text: text.replace('"numbers":[', '"numbers":[1.0,'),
    lambda text: text[: text.index('"reason"')] + '"reason":"\\u001b[2J"}',
]


@pytest.mark.parametrize("spoil", few(SPOILT, 3))
def test_plan_store_rewrites_damaged_files(capsys: Capture, plans: Path, spoil):
    Path("a.yaml").write_text(BELL)
    fresh, _ = printed_plan(capsys)
    good = {file: file.read_text() for file in plans.iterdir()}
    spoilt = {file: spoil(text) for file, text in good.items()}
    assert spoilt != good
    for file, text in spoilt.items():
        file.write_text(text)
    assert printed_plan(capsys) == (fresh, False)
    assert {file: file.read_text() for file in good} == good
    assert printed_plan(capsys) == (fresh, True)


def test_plan_store_unwritable_folder_ignored(capsys: Capture, plans: Path):
    plans.parent.mkdir(parents=True)
    plans.write_text("no folder")
    assert not printed_plan(capsys)[1]
    assert capsys.readouterr().err == ""


def test_plan_store_evicts_least_used_files(plans: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(plan_store, "_FILES_MAX", 3)
    store = PlanStore(plans)
    first = TrialRecord(
        [-60.5, None, 0.5], [[1, 2], []], "it has a contact, a law, a proxy or a mass that follows"
    )
    stranger = plans / "notes.txt"
    plans.mkdir(parents=True)
    stranger.write_text("mine")
    for index, key in enumerate("abcd"):
        store.put(key, first)
        store.forget()
        newest = max(plans.glob("*.json"), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (index, index))
        if key == "c":
            assert store.get("a") is not None  # used: it stays
    assert [store.get(key) is not None for key in "abcd"] == [True, False, True, True]
    assert store.get("d") == first
    monkeypatch.setattr(plan_store, "_BYTES_MAX", 10)
    PlanStore(plans).forget()
    assert list(plans.iterdir()) == [stranger]


def test_plan_store_folder_by_environment(tmp_path: Path):
    assert user_store({"ERGON_CACHE": "off", "XDG_CACHE_HOME": str(tmp_path)}) is None
    for environment in ({}, {"XDG_CACHE_HOME": ""}, {"XDG_CACHE_HOME": "not/absolute"}):
        store = user_store(environment)
        assert store is not None
        assert store._folder.path == Path.home() / ".cache" / "ergon" / "plans"
    alone = {"ERGON_CACHE": "plans", "XDG_CACHE_HOME": str(tmp_path)}
    assert user_store(alone) is not None
    assert cache_folder.user_folder("stretches", alone) is None
    assert cache_folder.user_folder("stretches", {"XDG_CACHE_HOME": str(tmp_path)}) is not None
