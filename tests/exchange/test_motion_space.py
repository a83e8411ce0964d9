"""Points in space in motion files and their exports: each is one; springs between them break."""

import struct
from pathlib import Path

import numpy as np
import pytest
from gltf_reader import Scene
from motion_reader import BREAK, BROKEN, INDEX, LINKS, STATE, Replica
from motions import chunk
from thrown import THROWN, places_of_ball

from ergon.cli import app
from ergon.exchange.motion_space import NotMotionError, points_in_space

TIMES = np.arange(0.0, 0.45, 0.1)
LOOK = 2e-3  # [m] that the ball flies off the line between two looks


@pytest.fixture(params=[2, 3])
def axes(request: pytest.FixtureRequest, work_folder: Path) -> int:
    axes: int = request.param
    (work_folder / "throw.yaml").write_text(THROWN[axes])
    assert app.run(["render", "-q", "throw.yaml", "-o", "throw.wav", "--motion"]) == 0
    return axes


def export(name: str) -> Path:
    assert app.run(["motion", "export", "-q", "throw.motion", "-o", name, "--fps", "10"]) == 0
    return Path(name)


def test_npz_holds_points_in_space_as_one(axes: int) -> None:
    with np.load(export("x.npz")) as raised:
        names, paths = raised["space_names"].tolist(), raised["space_positions"]
        assert raised["displacement"].shape[1] == 2 * axes + 1
    assert names == ["throw.nail", "throw.ball"]
    nail, ball = paths[: len(TIMES), 0], paths[: len(TIMES), 1]
    np.testing.assert_allclose(ball - nail, places_of_ball(TIMES, axes), atol=LOOK)
    assert (nail == nail[0]).all()


def test_csv_keeps_a_column_for_each_coordinate(axes: int) -> None:
    head = export("x.csv").read_text().splitlines()[1]
    coordinates = [f"throw.{point}.{axis}" for point in ("nail", "ball") for axis in "xyz"[:axes]]
    assert head == "t [s]," + ",".join(f'"{name} [m]"' for name in [*coordinates, "bell"])


def test_gltf_node_of_point_in_space(axes: int) -> None:
    scene = Scene(export("x.gltf"))
    children = [child for root in scene.roots for child in scene.children(root)]
    assert [scene.nodes[i]["name"] for i in children] == [
        *("throw.nail", "throw.ball", "bell"),
        "throw.nail, throw.ball",
    ]
    nail, ball, bell, thread = children
    assert (nail, "translation") not in scene.channels
    x, y, z = places_of_ball(TIMES, axes).T
    exact = np.stack([x, z, -y], axis=1)  # y is up in glTF
    result = [
        scene.value(ball, "translation", t) - scene.value(nail, "translation", t) for t in TIMES
    ]
    np.testing.assert_allclose(result, exact, atol=LOOK)
    for t in np.linspace(0.0, 0.45, 20):
        ends = scene.value(thread, "translation", t) + scene.line(thread) * scene.value(
            thread, "scale", t
        )
        there = [scene.value(node, "translation", t) for node in (nail, ball)]
        np.testing.assert_allclose(ends, there, atol=1e-6)
    # What is not in space is drawn larger still: the bell moves by some micrometres.
    _, path = scene.channels[bell, "translation"]
    assert np.ptp(path[:, 1]) > 0.01


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"a": 1}, "is not a list"),
        ([[0]], "names no such points"),
        ([[0, 1, 2, 3]], "names no such points"),
        ([[0, 4]], "names no such points"),
        ([[-1, 0]], "names no such points"),
        ([[0, True]], "names no such points"),
        ([["a", "b"]], "names no such points"),
        ([[[0], [1]]], "names no such points"),
        ([[0, 1], [2, 1]], "names a point twice"),
        ([[1, 1]], "names a point twice"),
    ],
)
def test_damaged_space_table_is_refused(table: object, sentence: str) -> None:
    with pytest.raises(NotMotionError, match=sentence):
        points_in_space(table, ["a.x", "a.y", "b", "c"])


def test_points_in_space_without_table() -> None:
    assert points_in_space(None, ["a"]) == []


TORN = """\
ergon: 1
instruments:
  w:
    space: 3
    modules:
      nail: {SOL: {X0: [0, 0, 0]}}
      ball: {MAS: {M: 1kg, X0: [10cm, 0, 0], V0: [0.4m/s, 0, 0]}}
      other: {MAS: {M: 1kg, X0: [0, 0, 10cm], V0: [0, 0, 0.1m/s]}}
      thread: {REF: {between: [nail, ball], K: 1kN/m, breaks: 8mm}}
      rope: {REF: {between: [nail, other], K: 1kN/m, breaks: 8mm}}
    out: {x: {SOX: ball.x}, z: {SOX: other.z}}
render: {tail: 1.5s}
"""
OMEGA = np.sqrt(1000.0)
BROKEN_AT = np.arcsin(8e-3 * OMEGA / 0.4) / OMEGA  # [s], of the thread; the rope holds


@pytest.fixture
def torn(work_folder: Path) -> Replica:
    (work_folder / "torn.yaml").write_text(TORN)
    assert app.run(["render", "-q", "torn.yaml", "-o", "torn.wav", "--motion"]) == 0
    return Replica((work_folder / "torn.motion").read_bytes())


def test_broken_link_chunks_repeat_after_key_states(torn: Replica) -> None:
    links = np.frombuffer(torn.single_payload(LINKS), "<u4", offset=4).reshape(-1, 2)
    rows = torn.records(BROKEN, BREAK)
    seen_at = rows[0][0]
    assert BROKEN_AT < seen_at < BROKEN_AT + 1 / 60
    states = [seconds for kind, seconds, *_ in torn.chunks if kind == STATE]
    assert [seconds for seconds, _ in rows[1:]] == [t for t in states if t > seen_at]
    for seconds, broken in rows:
        assert [[torn.names[p] for p in links[one]] for one in broken["link"]] == [
            ["w.nail.x", "w.ball.x"]
        ]
        assert seconds + broken["dt"][0] == pytest.approx(seen_at, abs=1e-6)


def test_broken_link_in_gltf_and_npz_exports(torn: Replica) -> None:
    seen_at = torn.records(BROKEN, BREAK)[0][0]
    assert app.run(["motion", "export", "-q", "torn.motion", "-o", "torn.gltf"]) == 0
    assert app.run(["motion", "export", "-q", "torn.motion", "-o", "torn.npz"]) == 0
    scene = Scene(Path("torn.gltf"))
    thread, rope = (scene.named(f"w.nail, w.{end}") for end in ("ball", "other"))
    assert scene.value(thread, "scale", seen_at - 1e-5)[0] > 0.1
    assert scene.value(thread, "scale", seen_at + 1e-5).tolist() == [0, 0, 0]
    assert scene.value(thread, "scale", 1.4).tolist() == [0, 0, 0]
    assert scene.value(rope, "scale", 1.4)[1] > 0.09
    with np.load("torn.npz") as raised:
        names = raised["space_names"].tolist()
        links = [tuple(names[end] for end in ends) for ends in raised["space_links"]]
        broken = dict(zip(links, raised["space_broken"].tolist(), strict=True))
    assert broken == {
        ("w.nail", "w.ball"): pytest.approx(seen_at, abs=1e-6),
        ("w.nail", "w.other"): np.inf,
    }


def test_export_of_file_without_broken_chunks(torn: Replica) -> None:
    data = Path("torn.motion").read_bytes()
    starts = [*(chunk[3] for chunk in torn.chunks), len(data)]
    saved = [
        data[start:end]
        for (kind, *_), start, end in zip(torn.chunks, starts, starts[1:], strict=False)
        if kind not in (BROKEN, INDEX)
    ]
    Path("old.motion").write_bytes(data[:8] + b"".join(saved))
    assert app.run(["motion", "export", "-q", "old.motion", "-o", "old.npz"]) == 0
    with np.load("old.npz") as raised:
        assert raised["space_broken"].tolist() == [np.inf, np.inf]


@pytest.mark.parametrize(
    ("kind", "payload", "sentence"),
    [
        (BROKEN, struct.pack("<fI", 0.0, 99), "not in its table"),
        (LINKS, struct.pack("<I", 7), "table of links is damaged"),
        (LINKS, b"", "table of links is damaged"),
        (LINKS, struct.pack("<III", 1, 0, 99), "names no such points"),
    ],
)
def test_damaged_links_are_refused(
    torn: Replica, capsys: pytest.CaptureFixture[str], kind: int, payload: bytes, sentence: str
) -> None:
    data = Path("torn.motion").read_bytes()
    (position, *_) = (position for own, _, _, position in torn.chunks if own == LINKS)
    Path("bad.motion").write_bytes(data[:position] + chunk(kind, 0.0, payload) + data[position:])
    for name in ("bad.npz", "bad.gltf"):
        assert app.run(["motion", "export", "-q", "bad.motion", "-o", name]) == 2
        assert sentence in capsys.readouterr().err
        assert not Path(name).exists()
