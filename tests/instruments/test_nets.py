"""Nets of points in space: discs, blocks, balls, meshes of files, grains at random places."""

import math
from itertools import combinations

import numpy as np
import pytest
from checked import check, check_reports

from ergon.instruments.space import count, nets
from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

STIFF = {"K": 300.0, "Z": 0.1, "normal": None, "held": "nothing"}


def springs(net: nets.Net) -> list[tuple[int, int, float]]:
    """The springs of all runs, one by one."""
    return [(run.first + i, run.second + i, run.rest) for run in net.runs for i in range(run.count)]


def near(places: np.ndarray, within: float) -> set[tuple[int, int]]:
    """All pairs of places that are not farther from each other than so."""
    reach = within * (1 + 1e-9)
    pairs = combinations(range(len(places)), 2)
    return {(i, j) for i, j in pairs if np.linalg.norm(places[i] - places[j]) <= reach}


def joined(net: nets.Net) -> set[tuple[int, int]]:
    """The pairs that springs join, each once, at rest where they begin."""
    places, result = np.array(net.positions), springs(net)
    pairs = {(min(a, b), max(a, b)) for a, b, _ in result}
    assert len(pairs) == len(result)
    for a, b, rest in result:
        assert math.dist(places[a], places[b]) == pytest.approx(rest, rel=1e-12)
    return pairs


@pytest.mark.parametrize(("sides", "span"), [((4, 3), 1), ((3, 4, 2), 1), ((4, 3, 5), 2)])
def test_block_joins_points_within_span(sides, span):
    axes = len(sides)
    stop = tuple(0.01 * (n - 1) for n in sides)
    fields = STIFF | {"sides": sides, "from": (0.0,) * axes, "to": stop, "span": span, "axes": axes}
    net = nets.block(fields)
    places = np.array(net.positions)
    assert len(places) == math.prod(sides) == count("BLOCK", fields)
    assert places.min(axis=0) == pytest.approx([0.0] * axes)
    assert places.max(axis=0) == pytest.approx(stop)
    cells = np.rint(places / 0.01)
    wanted = {
        (i, j)
        for i, j in combinations(range(len(cells)), 2)
        if np.abs(cells[i] - cells[j]).max() <= span
    }
    assert joined(net) == wanted
    for held, n_held in [("bottom", math.prod(sides[:-1])), ("top", math.prod(sides[:-1]))]:
        ends = np.array(nets.block(fields | {"held": held}).is_held)
        assert ends.sum() == n_held
        assert len(set(places[ends][:, -1])) == 1
    rim = nets.block(fields | {"held": "rim"}).is_held
    inner = math.prod(max(0, n - 2) for n in sides)
    assert len(places) - sum(rim) == inner


@pytest.mark.parametrize(("points", "axes"), [(3, 2), (7, 2), (6, 3), (9, 3)])
def test_ball_points_within_sphere(points, axes):
    fields = STIFF | {"points": points, "at": (0.02,) * axes, "across": 0.06, "span": 1}
    fields["axes"] = axes
    net = nets.ball(fields)
    places = np.array(net.positions)
    assert len(places) == count("BALL", fields)
    spacing = 0.06 / (points - 1)
    radius = np.linalg.norm(places - 0.02, axis=1).max()
    assert radius <= 0.03 * (1 + 1e-12)
    grid = 0.02 + spacing * (np.indices((points,) * axes).reshape(axes, -1).T - (points - 1) / 2)
    inside = np.linalg.norm(grid - 0.02, axis=1) <= 0.03 * (1 + 1e-9)
    assert inside.sum() == len(places)
    assert joined(net) == near(places, spacing * math.sqrt(axes))


@pytest.mark.parametrize(("rings", "axes"), [(1, 2), (4, 2), (4, 3)])
def test_disc_of_equal_triangles(rings, axes):
    fields = STIFF | {"rings": rings, "at": (0.1,) * axes, "across": 0.08, "axes": axes}
    net = nets.disc(fields)
    places = np.array(net.positions)
    assert len(places) == count("DISC", fields) == 1 + 6 * sum(range(rings + 1))
    assert np.linalg.norm(places - 0.1, axis=1).max() == pytest.approx(0.04)
    assert joined(net) == near(places, 0.04 / rings)
    assert sum(nets.disc(fields | {"held": "rim"}).is_held) == 6 * rings
    middle = nets.disc(fields | {"held": "middle"}).is_held
    assert places[middle.index(True)] == pytest.approx([0.1] * axes)
    assert sum(middle) == 1


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-2, 3, 0.1), (0, 1, 0)])
def test_disc_orientation_by_normal(normal):
    fields = STIFF | {"rings": 3, "at": (0.0,) * 3, "across": 0.08, "axes": 3}
    places = np.array(nets.disc(fields | {"normal": normal}).positions)
    assert places @ np.array(normal, float) == pytest.approx(0.0, abs=1e-15)
    flat = np.array(nets.disc(fields).positions)
    assert np.linalg.norm(places, axis=1) == pytest.approx(np.linalg.norm(flat, axis=1))


SCENE = """\
ergon: 1
seed: {seed}
instruments:
  a:
    space: {axes}
    gravity: 9.81m/s2
    modules:
      it: {{{net}}}
    out: {{{out}}}
rates: {{audio: 44100Hz}}
accuracy: {{method: ca}}
render: {{bits: float, tail: 0.1s}}
"""


def rendered(text: str) -> np.ndarray:
    built = stage(check(text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


def outputs(n: int, axes: int) -> str:
    points = [f"it.{i}.{c}" for i in range(n) for c in "xyz"[:axes]]
    return ", ".join(f"o{i}: {{SOX: {point}}}" for i, point in enumerate(points))


@pytest.mark.parametrize(
    "net",
    [
        "BLOCK: {sides: [3, 2, 2], from: [0, 0, 0], to: [2cm, 1cm, 1cm], V0: [0.1m/s, 0, 0], %s}",
        "BALL: {points: 3, at: [0, 0, 0], across: 2cm, V0: [0.1m/s, 0, 0], %s}",
        "DISC: {rings: 1, at: [0, 0, 0], across: 2cm, V0: [0.1m/s, 0, 0], %s}",
    ],
)
def test_net_in_free_fall_unchanged_shape(net):
    """No spring has a force at the beginning, and gravity pulls all points alike."""
    n = {"BLOCK": 12, "BALL": 7, "DISC": 7}[net.partition(":")[0]]
    single = net % "M: 20g, K: 500N/m, Z: 0.1Ns/m"
    paths = rendered(SCENE.format(axes=3, net=single, out=outputs(n, 3), seed=1)).reshape(-1, n, 3)
    moved = paths[-1] - paths[0]
    seconds = (len(paths) - 1) / 44_100
    assert moved[:, 0] == pytest.approx(0.1 * seconds, rel=1e-9)
    assert moved[:, 2] == pytest.approx(-0.5 * 9.81 * seconds**2, rel=1e-3)
    assert np.abs(moved - moved[0]).max() < 1e-12


def test_stretched_disc_lowest_mode_and_pull():
    """Its lowest mode is that of a hexagonal lattice under tension; its springs pull at the rim."""
    stretch, stiff, mass = 0.05, 2_000.0, 2e-4
    n_inner = count("DISC", {"rings": 5})
    net = (
        f"DISC: {{rings: 6, M: {mass * n_inner}kg, at: [0, 0, 0], across: 12cm, K: {stiff}, "
        f"stretch: {stretch}, held: rim}}"
    )
    text = SCENE.format(axes=3, net=net, out="z: {SOX: it.63.z}, y: {SOF: it}", seed=1)
    text = text.replace("9.81m/s2", "1e-6m/s2").replace("0.1s", "1s")
    z, pull = rendered(text).T
    # Each spring is longer than at rest by its share, and pulls: SOF is below 0.
    spacing = 0.01
    each = stiff * (spacing - spacing / (1 + stretch))
    assert pull[0] == pytest.approx(-each * 342, rel=1e-9)
    # Across itself a bond is as stiff as tension / length: eigenvalues of the lattice's Laplacian.
    cells = [(q, r) for r in range(-6, 7) for q in range(-6, 7) if abs(q + r) <= 6]
    inner = [(q, r) for q, r in cells if max(abs(q), abs(r), abs(q + r)) < 6]
    numbers = {cell: i for i, cell in enumerate(inner)}
    laplacian = 6.0 * np.eye(len(inner))
    for (q, r), i in numbers.items():
        for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1), (-1, 1), (1, -1)):
            if (j := numbers.get((q + a, r + b))) is not None:
                laplacian[i, j] -= 1.0
    lowest = np.sqrt(np.linalg.eigvalsh(laplacian)[0] * each / spacing / mass) / (2 * np.pi)
    crossings = np.flatnonzero(np.diff(np.sign(z - z.mean())) > 0)
    periods = np.diff(crossings)
    assert 44_100 / periods.mean() == pytest.approx(lowest, rel=0.02)


# --- grains at random places ----------------------------------------------------------------------

GRAINS = "GRAINS: {count: 40, M: 40g, from: [0, 0, 0], to: [5cm, 5cm, 5cm], apart: %s}"


def test_grains_random_places_and_distances():
    beginnings = []
    for seed in (1, 1, 2):
        text = SCENE.format(axes=3, net=GRAINS % "9mm", out=outputs(40, 3), seed=seed)
        beginnings.append(rendered(text)[0].reshape(40, 3))
    first, same, other = beginnings
    assert (first == same).all()
    assert (first != other).any()
    apart = [np.linalg.norm(a - b) for a, b in combinations(first, 2)]
    assert min(apart) >= 9e-3
    assert first.min() >= 0.0
    assert first.max() <= 0.05
    # No lattice: no two have a coordinate in common.
    assert len(np.unique(first)) == first.size


def test_grains_without_room_are_refused():
    text = SCENE.format(axes=3, net=GRAINS % "3cm", out="SOX: it.0.x", seed=1)
    with pytest.raises(StageError) as raised:
        stage(check(text).piece)
    assert "a.it: 8 of 40 points found a random place at least 0.03 m from all others" in str(
        raised.value
    )


# --- meshes of files ------------------------------------------------------------------------------

ROCK = """\
# a tetrahedron, as Blender writes it
mtllib rock.mtl
o rock
v 1.0 1.0 1.0
v 1.0 -1.0 -1.0
v -1.0 1.0 -1.0
v -1.0 -1.0 1.0 1.0
vn 0 0 1
f 1//1 2//1 3//1
f 1/1/1 2/1/1 \\
  4/1/1
l -1 3
"""


def loaded(tmp_path, obj: str, fields: str = "scale: 1cm", axes: int = 3):
    (tmp_path / "rock.obj").write_text(obj)
    net = f"MESH: {{file: rock.obj, at: [0, 0, 0], M: 8g, K: 1kN/m, {fields}}}"
    text = SCENE.format(axes=axes, net=net, out="SOX: it.0.x", seed=1)
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load(str(path))


def test_mesh_file_points_and_springs(tmp_path):
    piece = loaded(tmp_path, ROCK).piece
    (module,) = piece.instruments["a"].modules
    assert module.fields["file"].edges == ((0, 1), (1, 2), (0, 2), (1, 3), (0, 3), (2, 3))
    net = nets.mesh(module.fields)
    assert net.positions[0] == pytest.approx((0.01, 0.01, 0.01))
    assert all(rest == pytest.approx(0.01 * math.sqrt(8)) for _, _, rest in springs(net))
    assert stage(piece).built_network.network.n_lia == 6
    upright = nets.mesh(module.fields | {"up": "y", "held": "bottom"})
    assert upright.positions[1] == pytest.approx((-0.01, 0.01, -0.01))
    assert upright.is_held == [False, True, False, True]


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    "line",
    [
        *("p 1 2 3", "mg 1 0.5", "bevel off", "c_interp on", "d_interp off", "lod 7", "usemap off"),
        *("maplib a.map", "shadow_obj a.obj", "trace_obj a.obj", "vp 0.5 0.5", "s 1", "vt 0 0"),
        *("g Flügel_rechts", "o Körper", "usemtl weiß", "mtllib Häuser.mtl", "# Maße in cm"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_obj_file_with_other_keywords(tmp_path, line, encoding):
    """Of the format's keywords (Wavefront, Object Files, version 3.0, appendix B1)."""
    (tmp_path / "rock.obj").write_bytes(f"{line}\n{TRIANGLE}{line}\n".encode(encoding))
    net = "MESH: {file: rock.obj, at: [0, 0, 0], M: 8g, K: 1kN/m, scale: 1cm}"
    text = SCENE.format(axes=3, net=net, out="SOX: it.0.x", seed=1)
    score = load(tmp_path / "a.yaml", text=text)
    assert score.piece is not None, score.diagnostics
    (module,) = score.piece.instruments["a"].modules
    mesh = module.fields["file"]
    assert (len(mesh.points), len(mesh.edges), len(mesh.faces)) == (3, 3, 1)


@pytest.mark.parametrize(
    ("obj", "code", "line", "message"),
    [
        ("v 1 2\n", "E106", 1, "a vertex has three numbers"),
        ("v 1 2 nan\n", "E106", 1, "a vertex has three numbers"),
        ("v 0 0 1e9\n", "E105", 1, "a coordinate is at most 1,000,000"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "E106", 3, "a face has three corners"),
        ("v 0 0 0\nv 1 0 0\nl 1 3\n", "E106", 3, "'3' is not a vertex of a line above"),
        ("v 0 0 0\nv 1 0 0\nl 1 0\n", "E106", 3, "'0' is not a vertex"),
        ("v 0 0 0\nl 1 1\n", "E106", 2, "vertex 1 is written twice in a row"),
        ("v 0 0 0\ncurv 1 2\n", "E106", 2, "'curv' is not read"),
        ("v 0 0 0\nsurf 0 1 0 1 1 2\n", "E106", 2, "'surf' is not read"),
        ("call other.obj\n", "E106", 1, "'call' is not read"),
        ("v 0 0 0\n", "E106", 8, "the file has no edges"),
        ("v 0 0 0\nl 1 " + "9" * 5000 + "\n", "E106", 2, "is not a vertex"),
    ],
)
def test_obj_file_mistakes_with_line(tmp_path, obj, code, line, message):
    errors = loaded(tmp_path, obj).diagnostics
    assert [error.code for error in errors] == [code]
    assert message in errors[0].message
    assert errors[0].place.line == line


@pytest.mark.parametrize(
    ("net", "axes", "code", "said"),
    [
        (
            "BLOCK: {sides: [2000, 2000, 2000], M: 1g, from: [0, 0, 0], to: [1m, 1m, 1m], K: 1}",
            3,
            "E105",
            "a BLOCK has at most 500,000 points, not 8,000,000,000",
        ),
        (
            "BLOCK: {sides: [70, 70, 70], M: 1g, from: [0, 0, 0], to: [1m, 1m, 1m], K: 1, span: 3}",
            3,
            "E105",
            "a BLOCK has at most 2,000,000 springs",
        ),
        (
            "BLOCK: {sides: [4, 4], M: 1g, from: [0, 0, 0], to: [1m, 1m, 1m], K: 1}",
            3,
            "E106",
            "the number of items is 2, but must be 3: x, y and z",
        ),
        (
            "DISC: {rings: 2, M: 1g, at: [0, 0], across: 1m, K: 1, normal: [0, 1]}",
            2,
            "E111",
            "with two axes a disc lies in their plane",
        ),
        (
            "DISC: {rings: 2, M: 1g, at: [0, 0, 0], across: 1m, K: 1, normal: [0, 0, 0]}",
            3,
            "E105",
            "a normal of length 0",
        ),
        (
            "GRAINS: {count: 9, M: 1g, from: [0, 0], to: [1m, 1m], apart: 1cm, scatter: 10%}",
            2,
            "E111",
            "`apart` is written too",
        ),
    ],
)
def test_net_fields_with_mistakes(net, axes, code, said):
    text = SCENE.format(axes=axes, net=net, out="SOX: it.0.x", seed=1)
    assert any(code == own and said in message for own, _, message in check_reports(text))


def test_mesh_in_two_dimensions_is_refused(tmp_path):
    diagnostics = loaded(tmp_path, ROCK, axes=2).diagnostics
    assert any("write space: 3" in one.message for one in diagnostics)


def test_mesh_file_outside_score_folder_is_refused(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "rock.obj").write_text(ROCK)
    net = "MESH: {file: ../rock.obj, at: [0, 0, 0], M: 8g, K: 1kN/m}"
    (inner / "s.yaml").write_text(SCENE.format(axes=3, net=net, out="SOX: it.0.x", seed=1))
    diagnostics = load(str(inner / "s.yaml")).diagnostics
    assert [one.code for one in diagnostics] == ["E112"]
