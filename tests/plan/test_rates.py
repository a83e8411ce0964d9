"""Rates of keys and instruments: read, refused, planned, told."""

from pathlib import Path

import numpy as np
import pytest
from checked import check
from commands import records

from ergon.cli import app
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

HEAD = "ergon: 1\n"
REST = """\
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}
  link: {modules: {r: {REF: {K: 500N/m, between: [k1, bell.m]}}}}
gestures: {push: 0mm@0 smooth 5mm@60ms smooth 0mm@120ms}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: push}]}
render: {tail: 0.2s}
"""
KEYS = "keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\n"


def piece(text: str) -> Piece:
    read = check(text)
    assert read.piece is not None, read.diagnostics
    return read.piece


def test_key_rate_from_gesture_rate_or_key_field():
    plain = piece(HEAD + KEYS + REST)
    assert (plain.keys["k1"].every, plain.instruments["bell"].every) == (1, 1)
    assert piece(HEAD + "rates: {gesture: 4410Hz}\n" + KEYS + REST).keys["k1"].every == 10
    single = KEYS.replace("M: 400g", "rate: 8820Hz, M: 400g")
    assert piece(HEAD + "rates: {gesture: 4410Hz}\n" + single + REST).keys["k1"].every == 5
    faster = piece(HEAD + "rates: {audio: 96kHz, gesture: 4kHz}\n" + KEYS + REST)
    assert faster.keys["k1"].every == 24
    bell = piece(HEAD + KEYS + REST.replace("{modules: {m:", "{rate: 22050Hz, modules: {m:"))
    assert (bell.keys["k1"].every, bell.instruments["bell"].every) == (1, 2)
    assert digest_of(plain) != digest_of(bell)


@pytest.mark.parametrize(
    ("rate", "nearest"),
    [
        ("4kHz", "4009.090909Hz"),
        ("30kHz", "44100Hz"),
        ("60kHz", "44100Hz"),
        ("1kHz", "1002.272727Hz"),
    ],
)
@pytest.mark.parametrize("where", ["gestures", "key", "instrument"])
def test_rate_of_non_integer_fraction_is_refused(where: str, rate: str, nearest: str):
    def text(rate: str) -> str:
        rates = f"rates: {{gesture: {rate}}}\n" if where == "gestures" else ""
        key = KEYS.replace("M:", f"rate: {rate}, M:") if where == "key" else KEYS
        more = REST.replace("{modules: {m:", f"{{rate: {rate}, modules: {{m:")
        return HEAD + rates + key + (more if where == "instrument" else REST)

    result = check(text(rate)).diagnostics
    assert [(d.code, d.suggestion) for d in result] == [("E311", nearest)]
    assert result[0].place.length == len(rate)
    assert not check(text(nearest)).diagnostics


def test_slow_key_staged_sounds_alike():
    def rendered(text: str) -> np.ndarray:
        played = stage(piece(text), planned=True)
        assert not played.diagnostics
        out = np.zeros((8820, played.simulation.n_out))
        played.simulation.process(out)
        return out

    slow = HEAD + "rates: {gesture: 4410Hz}\n" + KEYS + REST
    plan = stage(piece(slow), planned=True).plan
    assert plan is not None
    (row,) = [row for row in plan.rows() if row.what == "e4"]
    assert (row.parts, row.macrostep, row.preserved) == (["k1"], 10, True)
    first, other = rendered(slow), rendered(HEAD + KEYS + REST)
    assert 0.0 < np.abs(first - other).max() < 10 ** (-60 / 20) * np.abs(other).max()


def test_tracked_key_at_the_audio_rate_is_noted():
    tracked = REST.replace("play: push", "play: push, touch: tracked")
    played = stage(piece(HEAD + "rates: {gesture: 4410Hz}\n" + KEYS + tracked), planned=True)
    (note,) = played.diagnostics
    assert note.code == "N403"
    assert "tracked" in note.message
    assert note.place.line == 3
    modes = KEYS + REST.replace("{modules: {m:", "{rate: 4410Hz, modules: {m:")
    alone = modes.replace("  link: {modules: {r: {REF: {K: 500N/m, between: [k1, bell.m]}}}}\n", "")
    alone += "strikes: {s: {to: bell.m, at: 0.1s, impulse: 1mNs}}\n"
    (note,) = stage(piece(HEAD + alone), planned=True).diagnostics
    assert note.code == "N403"
    assert "its poles need none" in note.message


LEVERS = """\
rates: {audio: 44100Hz, gesture: 8820Hz}
keys:
  k1:
    modules:
      ground: {SOL: {}}
      key: {MAS: {M: 300g}}
      lever: {MAS: {M: 40g}}
      tip: {MAS: {M: 10g}}
      a: {REF: {between: [ground, key], K: 60N/m, Z: 1.2Ns/m}}
      b: {REF: {between: [key, lever], K: 3kN/m, Z: 0.8Ns/m}}
      c: {REF: {between: [lever, tip], K: 2kN/m, Z: 0.3Ns/m}}
    struck: key
instruments:
  str:
    modules:
      s: {STRING: {masses: 60, M: 6g, f: 196Hz, t60: 3s}}
      hit: {REF: {between: [k1.tip, s.7], K: 4kN/m, Z: 0.05Ns/m}}
    out: {SOX: s.40}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@140ms}
players: {ada: {key: k1}}
parts: {ada: [{at: 0.1s, play: knock, every: 0.5s, times: 1}]}
mix: {channels: 1, route: [{from: str, to: 1}]}
accuracy: {error: -60dB}
render: {tail: 1.5s}
"""


def test_rates_of_linear_scene_without_chaos_note():
    """Errors of pitch add up in a linear motion; it never parts by chance."""
    staged = stage(piece(HEAD + LEVERS), planned=True)
    assert staged.plan is not None
    # At every frame -60 dB cost less: that may be noted, but no error above the budget.
    assert {note.code for note in staged.diagnostics} <= {"N403"}
    assert all(row.spectral_db is None for row in staged.plan.rows())


@pytest.mark.usefixtures("folder")
def test_rates_in_plan_table_and_why(capsys: pytest.CaptureFixture[str]):
    assert app.run(["plan", "s.yaml"]) == 0
    table = capsys.readouterr().out
    assert "exact flow (E4)" in table
    assert "dB, preserved" in table
    assert app.run(["plan", "s.yaml", "--why", "k1"]) == 0
    why = capsys.readouterr().out
    assert "Its springs act by their exact flow (E4)" in why
    assert "|λ| is" in why
    assert app.run(["plan", "s.yaml", "--json"]) == 0
    rows = records(capsys)
    (row,) = [row for row in rows if row.get("what") == "e4"]
    assert row["every"] == 10
    assert row["radius"] < 1.0
    assert row["preserved"] is True
    assert app.run(["plan", "s.yaml", "--method", "ca", "--why", "k1"]) == 0
    assert "not used for k1: the score asks for one method" in capsys.readouterr().out


@pytest.fixture
def folder(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ERGON_CACHE", "plans")  # of this score alone, which is planned four times
    monkeypatch.setenv("XDG_CACHE_HOME", str(work_folder / "cache"))
    Path("s.yaml").write_text(HEAD + "rates: {gesture: 4410Hz}\n" + KEYS + REST)
