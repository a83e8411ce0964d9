"""Points in space in exports of motion files: each is one, and moves along all its axes."""

from pathlib import Path

import numpy as np
import pytest
from gltf_reader import Scene
from thrown import THROWN, places_of_ball

from ergon.cli import app
from ergon.exchange.motion_space import NotMotionError, points_in_space

TIMES = np.arange(0.0, 0.45, 0.1)
LOOK = 2e-3  # [m] that the ball flies off the line between two looks


@pytest.fixture(params=[2, 3])
def axes(request: pytest.FixtureRequest, own_folder: Path) -> int:
    axes: int = request.param
    (own_folder / "throw.yaml").write_text(THROWN[axes])
    assert app.run(["render", "-q", "throw.yaml", "-o", "throw.wav", "--motion"]) == 0
    return axes


def export(name: str) -> Path:
    assert app.run(["motion", "export", "-q", "throw.motion", "-o", name, "--fps", "10"]) == 0
    return Path(name)


def test_npz_holds_points_in_space_as_one(axes: int) -> None:
    with np.load(export("x.npz")) as found:
        names, paths = found["space_names"].tolist(), found["space_positions"]
        assert found["displacement"].shape[1] == 2 * axes + 1
    assert names == ["throw.nail", "throw.ball"]
    nail, ball = paths[: len(TIMES), 0], paths[: len(TIMES), 1]
    np.testing.assert_allclose(ball - nail, places_of_ball(TIMES, axes), atol=LOOK)
    assert (nail == nail[0]).all()


def test_csv_keeps_a_column_for_each_coordinate(axes: int) -> None:
    head = export("x.csv").read_text().splitlines()[1]
    coordinates = [f"throw.{point}.{axis}" for point in ("nail", "ball") for axis in "xyz"[:axes]]
    assert head == "t [s]," + ",".join(f'"{name} [m]"' for name in [*coordinates, "bell"])


def test_a_node_of_gltf_flies_as_the_ball_does(axes: int) -> None:
    scene = Scene(export("x.gltf"))
    children = [child for root in scene.roots for child in scene.children(root)]
    assert [scene.nodes[i]["name"] for i in children] == ["throw.nail", "throw.ball", "bell"]
    nail, ball, bell = children
    assert (nail, "translation") not in scene.channels
    x, y, z = places_of_ball(TIMES, axes).T
    exact = np.stack([x, z, -y], axis=1)  # y is up in glTF
    found = [scene.at(ball, "translation", t) - scene.at(nail, "translation", t) for t in TIMES]
    np.testing.assert_allclose(found, exact, atol=LOOK)
    # What is not in space is drawn larger still: the bell moves by some micrometres.
    _, path = scene.channels[bell, "translation"]
    assert np.ptp(path[:, 1]) > 0.01


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"a": 1}, "is no list"),
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
def test_a_damaged_table_is_refused(table: object, sentence: str) -> None:
    with pytest.raises(NotMotionError, match=sentence):
        points_in_space(table, ["a.x", "a.y", "b", "c"])


def test_a_file_without_points_in_space_has_none() -> None:
    assert points_in_space(None, ["a"]) == []
