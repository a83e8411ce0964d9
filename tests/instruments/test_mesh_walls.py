"""Contacts with a surface of triangles: beside planes, edges and DOP853; files; mistakes."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from gltf_files import binary, tetrahedron
from scipy.integrate import solve_ivp
from sweep import few

from ergon.instruments.space import gltf_file
from ergon.instruments.space.mesh import MeshFileError
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

G = 9.81
# A floor of four triangles around its middle, and a roof whose ridge lies along y.
FLOOR = (
    "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0.02 0.01 0\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
)
ROOF = "v -1 -1 -1\nv 0 -1 0\nv 1 -1 -1\nv -1 1 -1\nv 0 1 0\nv 1 1 -1\nf 1 2 5 4\nf 2 3 6 5\n"

SCORE = """\
ergon: 1
rates: {audio: %dHz}
accuracy: {method: ca}
instruments:
  t:
    space: 3
    gravity: 9.81m/s2
    modules:
      base: {SOL: {X0: [0, 0, 5cm]}}
      ball: {MAS: {M: 20g, X0: [%s], V0: [%s]}}
      hit: {BUT: {between: [base, ball], K: 5kN/m, Z: %s, gap: 1cm, %s}}
    out: {x: {SOX: ball.x}, y: {SOX: ball.y}, z: {SOX: ball.z}, f: {SOF: hit}}
render: {bits: float, tail: 0.5s}
"""


def rendered(folder: Path, text: str) -> np.ndarray:
    """Outputs of a score in a folder (n_frames, n_out)."""
    path = folder / "score.yaml"
    path.write_text(text)
    loaded = load(path)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece, planned=True)
    sound = np.empty((staged.n_frames, staged.simulation.n_out))
    staged.simulation.process(sound)
    return sound


def scene(wall: str, rate: int = 44_100, *, at: str, speed: str, damping: str = "0.5Ns/m") -> str:
    return SCORE % (rate, at, speed, damping, wall)


@pytest.mark.parametrize("friction", ["", ", friction: 0.5"])
def test_mesh_wall_of_flat_surface_equals_plane(tmp_path: Path, friction: str):
    """A ball that jumps and slides over its edges goes as on a plane, but for rounding."""
    (tmp_path / "floor.obj").write_text(FLOOR)
    method = {"at": "0, 0, 8cm", "speed": "0.2m/s, 0.1m/s, 0"}
    plane = rendered(tmp_path, scene(f"normal: [0, 0, 1]{friction}", **method))
    mesh = rendered(tmp_path, scene(f"mesh: {{file: floor.obj}}{friction}", **method))
    assert (plane[:, 3] > 0).any()
    assert plane[-1, 0] > 0.005
    np.testing.assert_allclose(mesh, plane, rtol=0, atol=1e-9)


def test_mesh_wall_scale_and_up(tmp_path: Path):
    # In centimetres, and what is up is y: (x, y, z) as (y, z, x).
    turned = ""
    for kind, *numbers in map(str.split, FLOOR.splitlines()):
        if kind == "v":
            x, y, z = (100 * float(number) for number in numbers)
            numbers = [str(y), str(z), str(x)]
        turned += " ".join([kind, *numbers]) + "\n"
    (tmp_path / "floor.obj").write_text(turned)
    method = {"at": "0, 0, 8cm", "speed": "0, 0, 0"}
    plane = rendered(tmp_path, scene("normal: [0, 0, 1]", **method))
    mesh = rendered(tmp_path, scene("mesh: {file: floor.obj, scale: 1cm, up: y}", **method))
    np.testing.assert_allclose(mesh, plane, rtol=0, atol=1e-9)


def test_mesh_wall_ridge_against_dop853(tmp_path: Path):
    """It falls beside the ridge of a roof, rolls round it, and slides down one side."""
    (tmp_path / "roof.obj").write_text(ROOF)
    start = np.array([2e-3, 0.0, 0.075, 0.0, 0.05, 0.0])

    def nearest(x: float, z: float) -> tuple[float, float]:
        """What lies between the roof, in its middle, and (x, z), by planes and the ridge."""
        side = 1.0 if x > 0 else -1.0
        down = side * x - z  # along the slope, times the root of 2
        if down <= 0:
            return x, z
        far = (side * x + z) / 2
        return side * far, far

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        x, z = nearest(y[0], y[2] - 0.05)
        length = np.hypot(x, z)
        push = 5e3 * max(0.01 - length, 0.0) / 0.02
        return np.array([*y[3:], push * x / length, 0.0, push * z / length - G])

    errors = []
    for frames in (44_100, 88_200):
        text = scene(
            "mesh: {file: roof.obj}", frames, at="2mm, 0, 75mm", speed="0, 0.05m/s, 0", damping="0"
        )
        ours = rendered(tmp_path, text)[:: frames // 4_410, :3]
        when = np.arange(len(ours)) / 4_410
        exact = solve_ivp(
            rate, (0, when[-1]), start, "DOP853", when, rtol=1e-11, atol=1e-13, max_step=1e-4
        )
        errors.append(np.abs(ours - exact.y[:3].T).max())
    assert np.abs(exact.y[0]).max() > 0.02  # it left the ridge
    assert errors[1] < 2e-4
    assert errors[1] < 0.75 * errors[0]


NET = """ergon: 1
instruments:
  t:
    space: 3
    modules: {net: {MESH: {file: %s, M: 40g, at: [0, 0, 0], K: 100N/m}}}
    out: {net: {SOF: net}}
strikes: {a: {to: t.net.1.z, at: 0, impulse: 1mNs}}
render: {bits: float, tail: 0.1s}
"""


def test_glb_file_equals_gltf_file(tmp_path: Path):
    embedded, packed = json.dumps(tetrahedron()), binary(tetrahedron())
    assert gltf_file.read_binary(packed) == gltf_file.read(embedded)
    assert gltf_file.read(embedded).faces == ((0, 1, 2), (0, 2, 3))
    (tmp_path / "net.gltf").write_text(embedded)
    (tmp_path / "net.glb").write_bytes(packed)
    sounds = [rendered(tmp_path, NET % f"net.{kind}") for kind in ("gltf", "glb")]
    assert sounds[0].any()
    np.testing.assert_array_equal(*sounds)


def test_glb_overlay_text_restores_mesh(tmp_path: Path):
    """A journal holds a text, which stands for the file where that is gone."""
    file, score = tmp_path / "net.glb", tmp_path / "score.yaml"
    file.write_bytes(binary(tetrahedron()))
    score.write_text(NET % file.name)
    loaded = load(score)
    saved = loaded.files[str(file)].text
    file.unlink()
    again = load(score, overlay={str(file): saved})
    assert loaded.piece is not None
    assert again.piece is not None
    assert digest_of(again.piece) == digest_of(loaded.piece)
    file.write_text(saved)
    alike = load(score).piece
    assert alike is not None
    assert digest_of(alike) == digest_of(loaded.piece)


def _spoiled(at: int, data: bytes) -> bytes:
    whole = binary(tetrahedron())
    return whole[:at] + data + whole[at + len(data) :]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"glTF", "it is not a binary glTF file"),
        (_spoiled(4, struct.pack("<I", 1)), "glTF 2 is read, not version 1"),
        (_spoiled(8, struct.pack("<I", 2**31)), "it is incomplete"),
        (_spoiled(12, struct.pack("<I", 2**31)), "a chunk is longer than the file"),
        (_spoiled(16, b"JUNK"), "its first chunk is no JSON"),
        (binary(tetrahedron())[:8] + struct.pack("<I", 14) + b"12", "a chunk has no head"),
        (
            binary({**tetrahedron(), "buffers": [{"byteLength": 9, "uri": "a,"}]}).replace(
                b"BIN", b"BIX"
            ),
            "its data is in another file",
        ),
    ],
)
def test_damaged_glb_files_are_refused(data: bytes, said: str):
    with pytest.raises(MeshFileError, match=said):
        gltf_file.read_binary(data)


@pytest.mark.parametrize(("limit", "count"), few([(240_000, 1_000), (2_400_000, 10_000)], 1))
def test_gltf_node_count_limit(limit: int, count: int, monkeypatch: pytest.MonkeyPatch):
    assert gltf_file._READ_ITEMS_MAX == 2_400_000
    monkeypatch.setattr(gltf_file, "_READ_ITEMS_MAX", limit)
    root = tetrahedron()
    root["nodes"] = [{"mesh": 0}] * count
    root["scenes"] = [{"nodes": list(range(count))}]
    root["accessors"][1]["count"] = 40
    root["bufferViews"].append({"buffer": 0, "byteLength": 9_999})
    root["accessors"][0]["count"] = 400
    root["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(bytes(9_999)).decode()
    root["bufferViews"][0]["byteLength"] = 9_999
    with pytest.raises(MeshFileError, match=f"show more than {limit:,} vertices"):
        gltf_file.read(json.dumps(root))


LINES = "v 0 0 0\nv 1 0 0\nl 1 2\n"


@pytest.mark.parametrize(
    ("wall", "text", "code", "wanted"),
    [
        ("mesh: {file: floor.obj}, side: inside", FLOOR, "E111", "`mesh` is written too"),
        ("mesh: {file: floor.obj}, box: [1m, 1m, 1m]", FLOOR, "E111", "`mesh` is written too"),
        ("mesh: {file: floor.obj}", LINES, "E106", "no faces, which points could touch"),
        ("mesh: {file: none.obj}", FLOOR, "E107", "none.obj"),
        ("mesh: {scale: 2cm}", FLOOR, "E103", "'file'"),
        ("mesh: {file: floor.obj}", "v 1 1 1\nv 2 2 2\nv 3 3 3\nf 1 2 3\n", "", "area"),
    ],
)
def test_mesh_wall_mistakes(tmp_path: Path, wall: str, text: str, code: str, wanted: str):
    (tmp_path / "floor.obj").write_text(text)
    path = tmp_path / "score.yaml"
    path.write_text(scene(wall, at="0, 0, 8cm", speed="0, 0, 0"))
    loaded = load(path)
    if code:
        output = [(own.code, own.message) for own in loaded.diagnostics]
        assert any(own == code and wanted in message for own, message in output), output
    else:
        assert loaded.piece is not None
        with pytest.raises(Exception, match=wanted):
            stage(loaded.piece)


def test_mesh_wall_in_two_dimensions_is_refused(tmp_path: Path):
    (tmp_path / "floor.obj").write_text(FLOOR)
    text = scene("mesh: {file: floor.obj}", at="0, 8cm", speed="0, 0")
    text = text.replace("space: 3", "space: 2").replace("[0, 0, 5cm]", "[0, 0]")
    (tmp_path / "score.yaml").write_text(text)
    output = [own.message for own in load(tmp_path / "score.yaml").diagnostics]
    assert any("write space: 3" in message for message in output), output
