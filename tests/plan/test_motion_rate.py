"""What is only seen at a rate of its own: read, planned, computed, told."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from checked import check, check_reports
from commands import records
from oracle import matter
from sessions import Stepped

import ergon
from ergon import _core
from ergon.cli import app
from ergon.scores.reading.digest import digest_of
from ergon.scores.staging.stage import Stage, stage

G = 9.81
Capture = pytest.CaptureFixture[str]
BELL = "  bell: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}}, out: {SOX: m}}\n"
FLAG = """\
  flag:
    space: 3
    gravity: 9.81m/s2
    modules:
      net: {CLOTH: {sides: [6, 5], M: 10g, at: [0, 0, 0], across: [20cm, 0, 0],
        up: [0, 0, 15cm], K: 80N/m, Z: 5mNs/m, held: corners, drag: 1mNs/m}}
      stone: {MAS: {M: 5g, X0: [10cm, 15cm, 8cm], V0: [0, -2m/s, 0.5m/s]}}
      hit: {BUT: {between: [stone, net.all], K: 500N/m, Z: 0.1Ns/m, gap: 25mm}}
"""
REST = """\
strikes:
  ring: {to: bell.m, at: 0.1s, impulse: 1mNs}
  flick: {to: flag.stone.y, at: 0.3s, impulse: 2mNs}
render: {tail: 0.7s}
"""


def score(motion: str = "", flag: str = FLAG) -> str:
    return f"ergon: 1\n{motion}instruments:\n{BELL}{flag}{REST}"


def staged(text: str, *, is_seen: bool = True) -> Stage:
    read = check(text)
    assert read.piece is not None, read.diagnostics
    return stage(read.piece, planned=True, is_seen=is_seen)


def test_motion_rate_as_frame_count() -> None:
    plain = check(score()).piece
    assert plain.motion_step_frames == 1
    for text, every in {"2kHz": 22, "44100Hz": 1, "30kHz": 1, "22050Hz": 2, "1kHz": 44}.items():
        piece = check(score(f"rates: {{motion: {text}}}\n")).piece
        assert piece.motion_step_frames == every
        assert digest_of(piece) != digest_of(plain)
    faster = check(score("rates: {audio: 96kHz, motion: 2kHz}\n")).piece
    assert faster.motion_step_frames == 48


def test_motion_rate_above_audio_rate_is_refused() -> None:
    (first,) = check(score("rates: {motion: 48kHz}\n")).diagnostics
    assert (first.code, first.suggestion) == ("E311", "44100Hz")
    assert "48000 Hz is above the audio rate" in first.message
    assert first.place.length == len("48kHz")


def tangle(motion: int) -> tuple[str, dict[str, np.ndarray], list[matter.Link]]:
    """A fixed point and three masses that springs without dampers join: nobody hears them."""
    x0 = np.array([[0, 0, 0], [0.1, 0, 0.02], [0.15, 0.08, 0], [0.02, 0.12, -0.03]])
    v0 = np.array([[0, 0, 0], [0.2, -0.1, 0], [0, 0.3, 0.1], [-0.2, 0, 0.2]])
    mass = np.array([0.0, 0.01, 0.02, 0.015])
    pairs = [(0, 1, 60.0), (1, 2, 40.0), (2, 3, 90.0), (0, 3, 50.0), (1, 3, 30.0)]
    lines = ["      m0: {SOL: {X0: [0, 0, 0]}}"]
    for i in range(1, 4):
        place, speed = x0[i].tolist(), v0[i].tolist()
        lines.append(f"      m{i}: {{MAS: {{M: {mass[i]}kg, X0: {place}, V0: {speed}}}}}")
    links = []
    for a, b, k in pairs:
        lines.append(f"      s{a}{b}: {{REF: {{between: [m{a}, m{b}], K: {k}}}}}")
        links.append(matter.Link(a, b, k, 0.0, float(np.linalg.norm(x0[b] - x0[a]))))
    modules = "\n".join(lines)
    flag = f"  flag:\n    space: 3\n    gravity: 9.81m/s2\n    modules:\n{modules}\n"
    rest = "strikes: {ring: {to: bell.m, at: 0.1s, impulse: 1mNs}}\nrender: {tail: 0.4s}\n"
    head = f"ergon: 1\nrates: {{motion: {motion}Hz}}\ninstruments:\n"
    return head + BELL + flag + rest, {"x0": x0, "v0": v0, "mass": mass}, links


def test_motion_rate_part_against_dop853() -> None:
    """By the second order of its own step, and as far off as its plan says."""
    errors = []
    for motion in (2205, 4410):
        text, arguments, links = tangle(motion)
        built = staged(text)
        simulation, every = built.simulation, 44_100 // motion
        mats = [built.built_network.assembly.mats["flag", f"m{i}"] for i in range(1, 4)]
        n = int(0.4 * motion)
        exact = matter.solve(**arguments, links=links, when=np.arange(n) / motion, gravity=G)
        out = np.empty((every, simulation.n_out))
        apart, size = 0.0, 0.0
        for frame in range(n):
            x = simulation.positions()
            ours = np.array([[x[mat + axis] for axis in range(3)] for mat in mats])
            apart = max(apart, np.abs(ours - exact[frame, 1:]).max())
            size = max(size, np.abs(exact[frame, 1:] - arguments["x0"][1:]).max())
            simulation.process(out)
        errors.append(apart / size)
        assert built.plan is not None
        (row,) = built.plan.seen()
        assert (row.every, row.what) == (every, "stepped")
        output = 10 ** (row.error_db / 20)
        assert 0.1 * output < errors[-1] < 10 * output
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert errors[0] < 1e-2


def test_motion_rate_in_plan_table_and_why(work_folder: Path, capsys: Capture) -> None:
    Path("plain.yaml").write_text(score())
    Path("s.yaml").write_text(score("rates: {motion: 2kHz}\n"))
    assert app.run(["plan", "s.yaml"]) == 0
    shown = capsys.readouterr().out
    listened, _, seen = shown.partition("seen, and not heard (--see all):")
    assert "nothing: no output hears it" in listened
    assert "module by module, CA, once in 22 frames" in seen
    assert app.run(["plan", "s.yaml", "--why", "flag"]) == 0
    why = capsys.readouterr().out
    assert "by the CA scheme, once in 22 frames" in why
    assert "A pilot measured an error of" in why
    from_all = {}
    for name in ("plain.yaml", "s.yaml"):
        assert app.run(["plan", name, "--json"]) == 0
        lines = records(capsys)
        from_all[name] = lines[-1]["hash"], lines[-1]["cost"]
        only_seen = [one for one in lines if one["event"] == "plan_row" and one["only_seen"]]
        assert bool(only_seen) == (name == "s.yaml")
    # What is heard is planned as without a rate of motion.
    assert from_all["plain.yaml"] == from_all["s.yaml"]
    (row,) = only_seen
    assert (row["parts"], row["in_frames"], row["times"]) == (["flag"], 22, 1)
    assert -100 < row["error_db"] < -20
    assert row["error_over_s"] > 0.29


def test_motion_rate_part_cost_by_frames() -> None:
    """Modules times frames, by the table of costs."""
    costs = {}
    for motion in (44_100, 2205):
        built = staged(score(f"rates: {{motion: {motion}Hz}}\n"))
        assert built.plan is not None
        (costs[motion],) = (row.cost for row in built.plan.seen())
    assert costs[44_100] == pytest.approx(20 * costs[2205], rel=1e-12)


def test_stiff_seen_part_is_oversampled() -> None:
    stiff = FLAG.replace("K: 80N/m", "K: 80kN/m")
    built = staged(score("rates: {motion: 2kHz}\n", stiff))
    assert built.plan is not None
    (row,) = built.plan.seen()
    assert row.every / row.oversampling < 22
    plain = staged(score("rates: {motion: 2kHz}\n"), is_seen=False)
    assert plain.plan is not None
    assert not plain.plan.seen()
    assert not [one for one in plain.diagnostics if one.code == "N403"]


def rendered(name: str, motion: str, **options: object) -> tuple[bytes, bytes]:
    """The sound and the motion of a score."""
    Path(f"{name}.yaml").write_text(score(motion))
    how = ergon.FileOptions(force=True, motion=True, see="all", **options)  # type: ignore[arg-type]
    ergon.render_to_file(f"{name}.yaml", f"{name}.wav", how)
    sound = Path(f"{name}.wav").read_bytes()
    return sound[sound.index(b"data") :], Path(f"{name}.motion").read_bytes()


def positions(name: str) -> np.ndarray:
    target = f"{name}.npz"
    assert app.run(["motion", "export", f"{name}.motion", "-o", target, "--force"]) == 0
    with np.load(target) as held:
        return held["space_positions"]


def test_motion_rate_leaves_sound_unchanged(work_folder: Path) -> None:
    text = "rates: {motion: 2kHz}\n"
    sound, _ = rendered("each", "")
    slowly, motion = rendered("slow", text)
    assert sound == slowly
    each, slow = positions("each"), positions("slow")
    moved = np.abs(each - each[0]).max()
    assert 0 < np.abs(each - slow).max() < 2e-2 * moved
    for threads in (1, 3):
        assert rendered("again", text, threads=threads)[0] == sound
        again = Path("again.motion").read_bytes()
        assert again.count(b"flag") == motion.count(b"flag")
        assert np.array_equal(positions("again"), slow)


SESSION = """\
ergon: 1
rates: {audio: 8kHz, motion: 1kHz}
instruments:
  sky: {BANK: {count: 8, f: 100Hz..2kHz, t60: 3s, M: 1g}, out: {SOX: sky.all}}
  rope:
    space: 2
    gravity: 9.81m/s2
    modules: {c: {CHAIN: {masses: 9, M: 5g, from: [0, 0], to: [20cm, 10cm], K: 200N/m, Z: 1mNs/m}}}
strikes:
  rain: {to: sky.all, at: 1|1, every: 1, times: 40, impulse: 1uNs}
mix: {channels: 1, route: [{from: sky, to: 1}]}
"""


def test_motion_rate_session_replays_from_journal(tmp_path: Path) -> None:
    """A rope that moved while nobody heard it is heard from a line on."""
    stepped = Stepped(SESSION, tmp_path, is_seen=True)
    listened = SESSION.replace(
        "K: 200N/m, Z: 1mNs/m}}}", "K: 200N/m, Z: 1mNs/m}}}\n    out: {SOV: c.4.y}"
    )
    listened = listened.replace("to: 1}]", "to: 1}, {from: rope, to: 1}]")
    with closing(stepped):
        stepped.ok("play")
        stepped.run(1.0)
        simulation = stepped.session.schedule.running.stage.simulation
        runs = {run.part: run.kind for run in _core.MotionLook(simulation).runs()}
        assert runs["rope"] == "sampled"
        stepped.ok("gain sky -6dB")
        stepped.run(0.33)
        (tmp_path / "score.yaml").write_text(listened)
        stepped.ok("reload")
        stepped.run(1.5)
    sound = stepped.sound
    assert np.abs(sound[-4000:]).max() > 0
    again = stepped.again()
    assert len(again) > 0.9 * len(sound)
    assert np.array_equal(again, sound[: len(again)])
    first = json.loads(stepped.journal.read_text().splitlines()[0])
    assert first["see"] == "all"


def test_wrong_motion_rates_are_reported() -> None:
    assert check_reports(score("rates: {motion: fast}\n"))
    assert check_reports(score("rates: {motion: -2kHz}\n"))
    assert check_reports(score("rates: {motions: 2kHz}\n"))
