"""What is only seen and touches what is heard, at the rate of motion: planned, computed, told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from checked import check
from commands import records
from oracle import matter

import ergon
from ergon import _core
from ergon.cli import app
from ergon.scores.staging.stage import Stage, stage

G = 9.81
RATE = 44_100
Capture = pytest.CaptureFixture[str]
FLAG = """\
ergon: 1
rates: {motion: 2kHz}
instruments:
  flag:
    space: 3
    modules:
      net: {CLOTH: {sides: [3, 3], M: 6g, at: [0, 0, 0], across: [20cm, 0, 0],
        up: [0, 0, 15cm], K: 80N/m, Z: 5mNs/m, held: corners, drag: 1mNs/m, stretch: 20%}}
  cord: {modules: {c: {REF: {between: [flag.net.4.y, bell.m], K: 30N/m}}}}
  bell: {modules: {m: {CEL: {M: 20g, f: 440Hz, t60: 0.5s}}}, out: {SOX: m}}
strikes:
  ring: {to: bell.m, at: 0.1s, impulse: 1mNs}
  gust: {to: flag.net.4.y, at: 0.3s, impulse: 500uNs}
render: {tail: 0.7s}
"""


def staged(text: str, *, is_seen: bool = False) -> Stage:
    read = check(text)
    assert read.piece is not None, read.diagnostics
    return stage(read.piece, planned=True, is_seen=is_seen)


def slow_rows(made: Stage) -> list[_core.PlanRow]:
    assert made.plan is not None
    return [row for row in made.plan.rows() if row.macrostep is not None]


def played(built: Stage) -> np.ndarray:
    out = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(out)
    return out[:, 0]


def decibels(ours: np.ndarray, true: np.ndarray) -> float:
    true = true - true.mean()
    apart = ours - ours.mean() - true
    return float(10 * np.log10((apart**2).sum() / (true**2).sum()))


def rope(motion: int) -> tuple[str, dict[str, np.ndarray], list[matter.Link]]:
    """Three points that are seen, and by a spring from the last of them one that is heard."""
    x0 = np.array(
        [[0, 0, 0], [0.1, 0, 0], [0.2, 0.01, 0], [0.3, 0, 0.02], [0.4, 0, 0], [0.5, 0, 0]], float
    )
    v0 = np.zeros((6, 3))
    v0[1], v0[4] = [0, 0.3, 0.1], [0, -0.2, 0]
    mass = np.array([0.0, 0.01, 0.02, 0.015, 0.03, 0.0])
    pairs = [(0, 1, 60.0), (1, 2, 90.0), (2, 3, 70.0), (3, 4, 40.0), (4, 5, 300.0)]
    links = [
        matter.Link(a, b, k, 0.0, 0.9 * float(np.linalg.norm(x0[b] - x0[a]))) for a, b, k in pairs
    ]

    def spring(link: matter.Link, a: str, b: str) -> str:
        return f"{{REF: {{between: [{a}, {b}], K: {link.K}, rest: {link.rest!r}}}}}"

    def point(i: int) -> str:
        position = x0[i].tolist()
        if mass[i] == 0:
            return f"{{SOL: {{X0: {position}}}}}"
        return f"{{MAS: {{M: {mass[i]}kg, X0: {position}, V0: {v0[i].tolist()}}}}}"

    rope = [f"      m{i}: {point(i)}" for i in range(4)]
    rope += [f"      s{i}: {spring(links[i], f'm{i}', f'm{i + 1}')}" for i in range(3)]
    bob = [f"      m{i}: {point(i)}" for i in (4, 5)] + [f"      s: {spring(links[4], 'm4', 'm5')}"]
    space = "    space: 3\n    gravity: 9.81m/s2\n    modules:\n"
    text = (
        f"ergon: 1\nrates: {{motion: {motion}Hz}}\naccuracy: {{error: -20dB}}\ninstruments:\n"
        + "  rope:\n"
        + space
        + "\n".join(rope)
        + "\n  bob:\n"
        + space
        + "\n".join(bob)
        + "\n    out: {SOX: m4.y}\n  cord:\n    space: 3\n    modules:\n      c: "
        + spring(links[3], "rope.m3", "bob.m4")
        + "\nstrikes: {ring: {to: bob.m4.y, at: 0.35s, impulse: 1e-12Ns}}\nrender: {tail: 2s}\n"
    )
    return text, {"x0": x0, "v0": v0, "mass": mass}, links


def test_seen_part_sound_against_dop853() -> None:
    """By the second order of its own step, and no farther off than its plan says."""
    errors = []
    text, arguments, links = rope(RATE // 40)
    # The score of the other rate is the same motion.
    when = np.arange(staged(text).n_frames) / RATE
    exact = matter.solve(**arguments, links=links, when=when, gravity=G)
    for every in (40, 20):
        built = staged(rope(RATE // every)[0])
        (row,) = slow_rows(built)
        assert (row.parts, row.macrostep, row.what) == (["rope"], every, "stepped")
        assert row.error_s is not None
        n = min(built.n_frames, int(row.error_s * RATE))
        errors.append(decibels(played(built)[:n], exact[:n, 4, 1]))
        assert row.error_db is not None
        assert errors[-1] < row.error_db + 1.5  # which is of a longer time
        assert row.guarantee == "tried"
    assert 10.5 < errors[0] - errors[1] < 13.5  # a factor of 4 is 12 dB
    assert errors[0] < -20


def test_seen_part_error_as_plan_states() -> None:
    built, plain = staged(FLAG), staged(FLAG.replace("rates: {motion: 2kHz}\n", ""))
    (row,) = slow_rows(built)
    assert row.parts == ["flag"]
    assert row.offered
    assert built.plan is not None
    assert plain.plan is not None
    assert not slow_rows(plain)
    cost = [sum(row.cost for row in own.plan.rows()) for own in (built, plain) if own.plan]
    assert cost[0] < 0.7 * cost[1]
    assert row.error_db is not None
    assert row.error_db <= -60  # by ear
    # Each plan has an error of what is heard too.
    rows = [one for own in (built, plain) if own.plan for one in own.plan.rows()]
    errors = [10 ** (one.error_db / 20) for one in rows if one.error_db is not None]
    assert decibels(played(built), played(plain)) < 20 * np.log10(sum(errors)) + 1.5
    assert not [one for one in built.diagnostics if one.code == "N403"]


def test_seen_part_same_bytes_for_threads_and_plan(work_folder: Path) -> None:
    Path("s.yaml").write_text(FLAG)
    assert app.run(["plan", "s.yaml", "-o", "p.json"]) == 0
    sounds = []
    for name, options in {
        "once": {},
        "threads": {"threads": 3},
        "seen": {"motion": True, "see": "all"},
        "plan": {"plan": "p.json"},
    }.items():
        how = ergon.FileOptions(force=True, **options)  # type: ignore[arg-type]
        ergon.render_to_file("s.yaml", f"{name}.wav", how)
        sounds.append(Path(f"{name}.wav").read_bytes())
    assert all(sound == sounds[0] for sound in sounds)


def positions(name: str) -> np.ndarray:
    assert app.run(["motion", "export", f"{name}.motion", "-o", f"{name}.npz", "--force"]) == 0
    with np.load(f"{name}.npz") as held:
        return held["space_positions"]


def test_seen_part_positions_near_full_rate(work_folder: Path) -> None:
    for name, text in {"slow": FLAG, "each": FLAG.replace("rates: {motion: 2kHz}\n", "")}.items():
        Path(f"{name}.yaml").write_text(text)
        how = ergon.FileOptions(force=True, motion=True, see="all")
        ergon.render_to_file(f"{name}.yaml", f"{name}.wav", how)
    each, slow = positions("each"), positions("slow")
    moved = np.abs(each - each[0]).max()
    assert 0 < np.abs(each - slow).max() < 2e-2 * moved


def test_seen_part_rate_grows_with_the_asked_accuracy(
    work_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """The more exact the sound is to be, the more often; a tight budget leaves it at each frame."""
    often = []
    for asked in (-30, -90):
        built = staged(f"{FLAG}accuracy: {{error: {asked}dB}}\n")
        rows = slow_rows(built)
        often.append(rows[0].macrostep if rows else 1)
        assert all(row.error_db is not None and row.error_db <= asked for row in rows)
    assert often == sorted(often, reverse=True)
    assert often[0] > often[-1]
    Path("s.yaml").write_text(FLAG)
    monkeypatch.setenv("ERGON_CACHE", "plans")
    monkeypatch.setenv("XDG_CACHE_HOME", str(work_folder / "cache"))
    assert app.run(["plan", "s.yaml", "--why", "flag"]) == 0
    why = capsys.readouterr().out
    assert "by the CA scheme at that rate" in why
    assert app.run(["plan", "s.yaml", "--json"]) == 0
    (row,) = [one for one in records(capsys) if one.get("parts") == ["flag"]]
    assert row["every"] in (22, 11, 5, 2)


@pytest.mark.parametrize(
    "text",
    [
        FLAG.replace("corners, drag: 1mNs/m, stretch: 20%}}", "corners}}\n    out: {SOV: net.4.y}"),
        FLAG.replace("K: 80N/m", "K: 500kN/m"),
        f"{FLAG}accuracy: {{method: ca}}\n",
    ],
    ids=["heard", "stiff", "one method for everything"],
)
def test_seen_part_at_full_rate_when_stiff(text: str) -> None:
    built = staged(text, is_seen=True)
    assert not slow_rows(built)
    (message,) = (one for one in built.diagnostics if one.code == "N403")
    assert "no part goes at the rate of motion" in message.message
