"""`ergon render --motion`, `ergon info`, `ergon motion export`: from a score to other programs."""

import csv
from pathlib import Path

import numpy as np
import pytest
from commands import records
from gltf_reader import Scene
from motion_reader import CONTACTS, ERGON, ERGONS, HAND, HANDS, LEVELS, Replica
from one_bell import SCORE

from ergon.cli import app

Capture = pytest.CaptureFixture[str]
UNHEARD = SCORE.replace(
    "gestures:",
    """  dark:
    modules:
      s: {STRING: {masses: 12, f: 110Hz, t60: 3s, M: 10g}}
gestures:""",
).replace(
    "mix:",
    """strikes:
  pluck: {to: dark.s.3, at: 1|2, impulse: 1mNs}
mix:""",
)


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    (work_folder / "bell.yaml").write_text(UNHEARD)
    return work_folder


def render(name: str, *options: str) -> tuple[bytes, bytes]:
    """The sound, and what moved."""
    assert app.run(["render", "-q", "bell.yaml", "-o", f"{name}.wav", *options]) == 0
    motion = Path(f"{name}.motion")
    return Path(f"{name}.wav").read_bytes(), motion.read_bytes() if motion.exists() else b""


def test_motion_render_same_bytes_for_threads_and_blocks() -> None:
    sound, none = render("blind")
    assert none == b""
    plain, motion = render("a", "--motion")
    assert plain == sound
    seen, all_of_it = render("b", "--motion", "--see", "all")
    assert seen == sound
    assert all_of_it != motion
    for i, how in enumerate((["--threads", "1"], ["--threads", "3"], ["--block", "100"])):
        assert render(f"c{i}", "--motion", "--see", "all", *how) == (sound, all_of_it)
    replica = Replica(all_of_it)
    kinds = {(part["name"], part["kind"]) for part in replica.manifest["parts"]}
    assert {("dark", "modal"), ("bell", "sampled"), ("k1", "sampled")} <= kinds
    unseen = {part["name"]: part["why"] for part in Replica(motion).manifest["parts"]}
    assert unseen["dark"] == "unheard"
    assert unseen["bell"] is None


def test_motion_file_keys_contacts_marks_and_sources() -> None:
    _, motion = render("a", "--motion")
    replica = Replica(motion)
    assert replica.manifest["keys"] == [
        {"name": "k1", "point": replica.names.index("k1"), "player": "ada", "hand": False}
    ]
    (key,) = (part for part in replica.manifest["parts"] if part["name"] == "k1")
    number = replica.manifest["parts"].index(key)
    times, moved = replica.frames()[number]
    hands = replica.records(HANDS, HAND)
    assert len(hands) == len(times)
    position = replica.names.index("k1") - key["first"]
    bound = replica.manifest["bound"]["amplitude"] * 0.5 * float(np.ptp(moved[:, position]))
    for (_, hand), row in zip(hands, moved, strict=True):
        assert float(hand["position"][0]) == pytest.approx(
            row[position], rel=1e-6, abs=1.01 * bound
        )
    # The knock aims at 6 mm; the bell is in its way, and looks fall beside the highest point.
    assert 4e-3 < max(float(hand["position"][0]) for _, hand in hands) < 6.1e-3
    assert not np.isnan(hands[2][1]["asked"][0])
    levels = replica.records(LEVELS, np.dtype("<f4"))
    assert {len(level) for _, level in levels} == {2}
    assert max(level.max() for _, level in levels) > 0.0
    assert replica.manifest["contacts"] == [
        {"name": "bell.b", "a": replica.names.index("k1"), "b": replica.names.index("bell.m")}
    ]
    assert any(kind == CONTACTS for kind, *_ in replica.chunks)
    assert [mark["name"] for mark in replica.manifest["marks"]] == ["A", "B"]
    assert {source["file"] for source in replica.manifest["sources"]} == {"bell.yaml"}


def test_motion_file_ergons_sum_to_compiled_impulse(capsys: Capture) -> None:
    _, motion = render("a", "--motion")
    replica = Replica(motion)
    key = replica.names.index("k1")
    output = [
        (t + float(e["dt"]), float(e["impulse"]), int(e["source"]))
        for t, all_ in replica.records(ERGONS, ERGON)
        for e in all_
        if e["point"] == key
    ]
    capsys.readouterr()
    assert app.run(["compile", "bell.yaml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = [line for line in lines if not line.startswith("#")]
    struck = [row for row in csv.DictReader(table) if row["struck"] == "k1"]
    assert len(struck) > 10_000
    times = np.array([float(row["time [s]"]) for row in struck])
    impulses = np.array([float(row["sign"] + row["impulse [N·s]"]) for row in struck])
    position, seen = (np.array(column) for column in list(zip(*output, strict=True))[:2])
    assert len(seen) < 1.5 * 60 * (times[-1] - times[0])
    # In each look all that pushed up, and all that pushed down.
    looks = np.arange(0, int(60 * times[-1]) + 2)
    edges = (looks * 44_100 / 60 + 0.5).astype(int) / 44_100 - 1e-7
    for sign in (1.0, -1.0):
        first = [
            np.histogram(t[sign * p > 0], edges, weights=p[sign * p > 0])[0]
            for t, p in ((times, impulses), (position, seen))
        ]
        np.testing.assert_allclose(first[1], first[0], rtol=1e-5, atol=1e-12)
        assert np.abs(first[0]).sum() > 0.1
    sources = {replica.manifest["sources"][source]["line"] for *_, source in output}
    (knock,) = (
        position for position, line in enumerate(UNHEARD.splitlines(), 1) if "knock: " in line
    )
    assert sources == {knock}


def test_info_of_motion_file(capsys: Capture) -> None:
    render("a", "--motion")
    assert app.run(["info", "--json", "a.motion"]) == 0
    (record,) = records(capsys)
    assert record["event"] == "motion"
    assert (record["state"], record["points"], record["fps"]) == ("whole", 14, 60.0)
    assert record["contacts"] > 0
    data = Path("a.motion").read_bytes()
    Path("a.motion").write_bytes(data[:-30])
    assert app.run(["info", "a.motion"]) == 0
    assert ", cut\n" in capsys.readouterr().out
    Path("a.motion").write_bytes(b"RIFF" + data[4:])
    assert app.run(["info", "a.motion"]) == 2
    assert "this is not a motion file" in capsys.readouterr().err


def test_motion_export_npz_and_csv_equal_reader() -> None:
    _, motion = render("a", "--motion", "--see", "all")
    replica = Replica(motion)
    for name in ("x.npz", "x.csv"):
        assert app.run(["motion", "export", "-q", "a.motion", "-o", name, "--fps", "60"]) == 0
    with np.load("x.npz") as raised:
        t, moved, names = raised["t"], raised["displacement"], raised["names"]
    assert names.tolist() == replica.names
    there = replica.displacements(t)
    free = [part for part in replica.manifest["parts"] if part["kind"] != "sampled"]
    for part in free:
        single = slice(part["first"], part["first"] + part["count"])
        assert np.allclose(moved[:, single], there[:, single], rtol=1e-5, atol=1e-12)
    for part, (times, values) in replica.frames().items():
        single = replica.manifest["parts"][part]
        columns = slice(single["first"], single["first"] + single["count"])
        n = min(len(times), len(t))
        # Between frames a reader draws a straight line: instants here are frames but for a sample.
        assert np.abs(moved[:n, columns] - values[:n]).max() <= 0.01 * np.abs(values).max()
    rows = list(csv.reader(Path("x.csv").read_text().splitlines()[1:]))
    assert rows[0] == ["t [s]", *(f"{name} [m]" for name in replica.names)]
    numbers = np.array([[float(x or "nan") for x in row] for row in rows[1:]])
    assert np.allclose(numbers[:, 1:], moved, rtol=1e-6, equal_nan=True)


def test_motion_export_gltf_node_per_point() -> None:
    _, motion = render("a", "--motion", "--see", "all")
    replica = Replica(motion)
    how = ["--fps", "30", "--exaggeration", "100"]
    assert app.run(["motion", "export", "-q", "a.motion", "-o", "x.gltf", *how]) == 0
    scene = Scene(Path("x.gltf"))
    assert [scene.nodes[root]["name"] for root in scene.roots] == [
        part["name"] for part in replica.manifest["parts"]
    ]
    children = [child for root in scene.roots for child in scene.children(root)]
    assert [scene.nodes[child]["name"] for child in children] == replica.names
    assert len(scene.channels) == len(replica.names)
    checked = 0
    for (node, _), (times, path) in scene.channels.items():
        point = children.index(node)
        part = next(
            p for p in replica.manifest["parts"] if p["first"] <= point < p["first"] + p["count"]
        )
        if part["kind"] == "sampled":
            continue
        moved = 100.0 * replica.displacements(np.arange(len(times)) / 30.0)[:, point]
        still = scene.nodes[node]["translation"]
        assert np.allclose(path[:, 1] - still[1], moved, rtol=1e-4, atol=1e-6)
        checked += 1
    assert checked >= 12


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["render", "bell.yaml", "--see", "all"], "add the option motion"),
        (["render", "bell.yaml", "--motion", "-o", "-"], "gives the motion file no name"),
        (["motion", "export", "a.motion"], "name the file to write"),
        (["motion", "export", "a.motion", "-o", "x.usd"], ".csv, .npz, .gltf"),
        (["motion", "export", "no.motion", "-o", "x.npz"], "No such file"),
        (["motion", "export", "a.motion", "-o", "a.motion"], ".csv, .npz, .gltf"),
        (["motion", "export", "a.motion", "-o", "x.csv", "--exaggeration", "2"], "for glTF"),
    ],
)
def test_motion_commands_refusals(capsys: Capture, words: list[str], sentence: str) -> None:
    render("a", "--motion")
    capsys.readouterr()
    assert app.run(words) == 2
    assert sentence in capsys.readouterr().err
    assert not list(Path().glob("x.*"))


def test_motion_render_refuses_foreign_file(capsys: Capture) -> None:
    Path("a.motion").write_bytes(b"mine")
    assert app.run(["render", "-q", "bell.yaml", "-o", "a.wav", "--motion"]) == 2
    assert "a.motion exists" in capsys.readouterr().err
    assert Path("a.motion").read_bytes() == b"mine"
    assert not Path("a.wav").exists()
    render("a", "--motion", "-f")
    render("a", "--motion")  # ours
