"""Motion capture as takes: C3D, BVH, TRC, TSV of Qualisys, CSV of OptiTrack, SDIF."""

import math
import re

import ezc3d
import motion_files as files
import numpy as np
import pytest

from ergon.scores.gesture import bvh_file, c3d_file
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import Samples, read

PLACES = files.curve()


def wrote(tmp_path, suffix, data):
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(data)
    return path


def is_of(
    outcome: Samples, places, point: int, axis: int, rate: float = 100.0, metres: float = 1e-3
):
    """Whether a take is an axis of a point, from its first frame on."""
    x = places[:, point, axis]
    seen = np.isfinite(x)
    assert np.allclose(outcome.t, np.flatnonzero(seen) / rate, rtol=0, atol=1e-12)
    assert np.allclose(outcome.x, (x[seen] - x[seen][0]) * metres, rtol=1e-12, atol=1e-15)
    return True


# --- C3D ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("analog", [0, 3])
@pytest.mark.parametrize("scale", [-1.0, 0.0625])
@pytest.mark.parametrize("processor", files.PROCESSORS)
def test_c3d_of_each_processor_and_scale(tmp_path, processor, scale, analog):
    path = wrote(
        tmp_path, ".c3d", files.c3d(PLACES, ("RWRI", "LWRI"), processor, scale, analog=analog)
    )
    for point, name in enumerate(("RWRI", "LWRI")):
        for axis, letter in enumerate("xyz"):
            assert is_of(read(path, f"{name}.{letter}"), PLACES, point, axis)


def test_c3d_written_by_ezc3d(tmp_path):
    """By ezc3d, which nothing else of ergon uses: values, names, rate, hidden points, analog."""
    chance = np.random.default_rng(7)
    places = chance.normal(size=(3000, 5, 3)).astype(np.float32).astype(float)
    places[100:105, 2] = np.nan
    built = ezc3d.c3d()
    built["parameters"]["POINT"]["RATE"]["value"] = [240.0]
    built["parameters"]["POINT"]["LABELS"]["value"] = [f"sub:M{i}" for i in range(5)]
    built["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
    built["parameters"]["ANALOG"]["RATE"]["value"] = [480.0]
    built["parameters"]["ANALOG"]["LABELS"]["value"] = ["force", "emg"]
    built["data"]["points"] = np.concatenate([places.transpose(2, 1, 0), np.ones((1, 5, 3000))])
    built["data"]["analogs"] = chance.normal(size=(1, 2, 6000))
    built.write(str(tmp_path / "walk.c3d"))
    assert is_of(read(tmp_path / "walk.c3d", "sub:M4.y"), places, 4, 1, 240.0, 1.0)
    result = read(tmp_path / "walk.c3d", "sub:M2.z")
    assert is_of(result, places, 2, 2, 240.0, 1.0)
    assert result.damage == "'sub:M2' is not seen in 5 frames; a spline runs across them"


def channels_used(count: int):
    return (3, "USED", 2, (), files._Numbers("intel").word(count))


@pytest.mark.parametrize("scale", [-1.0, 0.0625])
@pytest.mark.parametrize("stated", [{"stated_analog": 2}, {"stated_points": 1}])
def test_c3d_frame_length_by_file_size(tmp_path, scale, stated):
    """Headers that count the channels but not their samples, or not all the points."""
    places = files.curve(200)
    more = {"analog": 6, "samples": 3, "parameters": (channels_used(2),), **stated}
    data = files.c3d(places, scale=scale, **more)
    for padding in (b"", bytes(-len(data) % 512)):
        path = wrote(tmp_path, ".c3d", data + padding)
        for axis, letter in enumerate("xyz"):
            assert is_of(read(path, f"LWRI.{letter}"), places, 1, axis)


def test_c3d_frame_length_by_trailing_zeros(tmp_path):
    data = files.c3d(PLACES, analog=6, samples=3, parameters=(channels_used(2),), stated_analog=2)
    assert 12 * 4 * (6 - 2) < 512
    assert is_of(read(wrote(tmp_path, ".c3d", data), "LWRI.y"), PLACES, 1, 1)


def test_c3d_with_contradictory_frame_length_is_refused(tmp_path):
    places = files.curve(200)
    data = files.c3d(places, analog=5, samples=3, parameters=(channels_used(2),), stated_analog=2)
    with pytest.raises(TakeError, match=r"2 points with 2 .*or 2 points with 6 analog values, and"):
        read(wrote(tmp_path, ".c3d", data), "LWRI.y")


def test_c3d_with_more_frames_than_header_field(tmp_path):
    places = np.zeros((66_000, 1, 3))
    places[:, 0, 0] = np.arange(66_000) % 500
    single = files._Numbers("intel")
    begin = (2, "ACTUAL_START_FIELD", 2, (2,), single.word(1) + single.word(0))
    end = (2, "ACTUAL_END_FIELD", 2, (2,), single.word(66_000 - 65_536) + single.word(1))
    data = files.c3d(places, ("p",), scale=1.0, parameters=(begin, end))
    assert is_of(read(wrote(tmp_path, ".c3d", data), "p.x"), places, 0, 0)


def test_c3d_point_names_are_distinct(tmp_path):
    path = wrote(tmp_path, ".c3d", files.c3d(files.curve(4, 4), ("a", "a", "b")))
    assert c3d_file.read(path).points == ("a", "a 2", "b", "4")


def test_c3d_without_unit_needs_unit_option(tmp_path):
    path = wrote(tmp_path, ".c3d", files.c3d(PLACES, unit=None))
    with pytest.raises(TakeError, match=r"write what 1\.0 means") as caught:
        read(path, "RWRI.x")
    assert caught.value.field == "unit"
    assert is_of(read(path, "RWRI.x", unit=0.01), PLACES, 0, 0, metres=0.01)
    known = wrote(tmp_path, ".c3d", files.c3d(PLACES))
    with pytest.raises(TakeError, match="states its own unit"):
        read(known, "RWRI.x", unit=0.01)
    with pytest.raises(TakeError, match="states its own rate"):
        read(known, "RWRI.x", rate=100.0)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (files.c3d(PLACES)[:-1], "of 12 frames 11 are there"),
        (files.c3d(PLACES)[:300], "this is not a C3D file"),
        (files.c3d(PLACES)[:700], "of 12 frames 0 are there"),
        (b"\2\x50" + bytes(510) + bytes(512), "no parameters"),
        (files.c3d(files.curve(3, 0), ()), "no points that move"),
        (files.c3d(PLACES)[:12] + b"\0\0\xc0\x7f" + files.c3d(PLACES)[16:], "header is damaged"),
    ],
)
def test_c3d_malformed_files_are_refused(tmp_path, data, told):
    with pytest.raises(TakeError, match=told):
        read(wrote(tmp_path, ".c3d", data), "RWRI.x")


# --- which point, which axis ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("channel", "message", "suggestion"),
    [
        (None, r"such as RWRI\.x; the points are RWRI, LWRI", None),
        ("RWRI", "not a point with an axis", "RWRI.x"),
        ("RWRI.w", "not a point with an axis", "RWRI.x"),
        ("RWIR.z", "no point 'RWIR'; there are RWRI, LWRI", "RWRI.z"),
        ("head.z", "no point 'head'; there are RWRI, LWRI", None),
    ],
)
def test_unknown_channel_lists_and_suggests_channels(tmp_path, channel, message, suggestion):
    path = wrote(tmp_path, ".c3d", files.c3d(PLACES))
    with pytest.raises(TakeError, match=message) as caught:
        read(path, channel)
    assert (caught.value.suggestion, caught.value.field) == (suggestion, "channel")


def test_auto_channel_follows_main_direction(tmp_path):
    """A point that goes 300 mm along a line in space, and a little across it."""
    s = np.linspace(0, 1, 200)
    along = s**3 * (10 - 15 * s + 6 * s * s)
    line, across = np.array([2.0, -1.0, 2.0]) / 3, np.array([1.0, 2.0, 0.0]) / math.sqrt(5)
    places = 300 * along[:, None] * line + 3 * np.sin(40 * s)[:, None] * across
    data = files.c3d(np.stack([places, places[::-1]], 1))
    result = read(wrote(tmp_path, ".c3d", data), "RWRI.auto")
    assert np.abs(result.x - 0.3 * along).max() < 3e-4
    # It goes towards its farther end, wherever it begins.
    back = read(tmp_path / "walk.c3d", "LWRI.auto")
    assert np.abs(back.x - 0.3 * along).max() < 3e-4
    turning = np.stack([np.cos(6 * s), np.sin(6 * s), s], 1) * 100
    path = wrote(tmp_path, ".c3d", files.c3d(np.stack([turning, 0 * turning], 1)))
    with pytest.raises(TakeError, match="not move along a straight line"):
        read(path, "RWRI.auto")
    with pytest.raises(TakeError, match="does not move"):
        read(path, "LWRI.auto")


@pytest.mark.parametrize("suffix", [".c3d", ".tsv"])
def test_point_hidden_for_long_is_refused(tmp_path, suffix):
    write = files.c3d if suffix == ".c3d" else files.qtm
    places = files.curve(200)
    places[50:80, 0] = np.nan
    places[:30, 1] = np.nan
    path = wrote(tmp_path, suffix, write(places))
    with pytest.raises(TakeError, match=r"'RWRI' is not seen from 0.500 s to 0.800 s"):
        read(path, "RWRI.x")
    # What is hidden before it is seen first is no gap.
    result = read(path, "LWRI.x")
    assert is_of(result, places, 1, 0)
    assert result.damage is None
    places[1:, 1] = np.nan
    with pytest.raises(TakeError, match="seen in no two frames"):
        read(wrote(tmp_path, suffix, write(places[30:])), "LWRI.x")


# --- BVH ------------------------------------------------------------------------------------------


def turned(angle: float, axis: int):
    """A rotation as a product of complex numbers, by columns."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    for column in (j, k):
        z = complex(matrix[j, column], matrix[k, column]) * complex(
            math.cos(angle), math.sin(angle)
        )
        matrix[j, column], matrix[k, column] = z.real, z.imag
    return matrix


def test_bvh_joint_positions_by_rotation_matrices(tmp_path):
    """Against one frame at a time, joint by joint, from the end of the limb back to the hips."""
    rows = np.random.default_rng(3).uniform(-180, 180, (400, 12))
    path = wrote(tmp_path, ".bvh", files.bvh(rows))
    motion = bvh_file.read(path)
    assert motion.points == ("hips", "arm", "hand", "hand end")
    result = np.concatenate(list(motion.blocks()))
    for row, places in zip(rows, result, strict=True):
        z, x, y = 2, 0, 1
        a = np.radians(row)
        hand = turned(a[9], z) @ turned(a[10], y) @ turned(a[11], x) @ [5, 0, 0] + [20, 0, 0]
        arm = turned(a[6], z) @ turned(a[7], x) @ turned(a[8], y) @ hand + [0, 10, 0]
        end = turned(a[3], z) @ turned(a[4], x) @ turned(a[5], y) @ arm + row[:3]
        assert np.allclose(places[3], end, atol=1e-6)
        assert np.allclose(places[0], row[:3], atol=1e-6)
    taken = read(path, "hand end.y", unit=0.01)
    assert np.allclose(taken.x, (result[:, 3, 1] - result[0, 3, 1]) * 0.01)
    assert np.allclose(taken.t, np.arange(400) * 0.01)
    with pytest.raises(TakeError, match="such as unit: 1cm"):
        read(path, "hand.x")


ROWS = np.random.default_rng(4).uniform(-90, 90, (5, 12))
PLAIN = files.bvh(ROWS).decode()
HEAD, FRAMES = PLAIN[: PLAIN.index("MOTION")], PLAIN[PLAIN.index("MOTION") :]
LAYOUTS = {
    "capitals": HEAD.upper() + FRAMES.upper(),
    "small letters": HEAD.lower() + FRAMES.lower(),
    "one line": " ".join(HEAD.split()) + "\n" + FRAMES,
    "a word a line": "\n".join(PLAIN.split()),
    "braces without spaces": HEAD.replace(" {", "{").replace("\n{", "{") + FRAMES,
    "wrapped frames": HEAD + re.sub(r"((?:\S+ ){5}\S+) ", r"\1\n", FRAMES),
    "no space after the colon": PLAIN.replace("Frames: ", "Frames:").replace("Time: ", "Time:\t"),
    "a space before the colon": PLAIN.replace("Frames:", "Frames :").replace("Time:", "Time :"),
    "lines of Windows": PLAIN.replace("\n", "\r\n"),
    "empty lines": PLAIN.replace("\n", "\n\n"),
}


@pytest.mark.parametrize("text", LAYOUTS.values(), ids=LAYOUTS)
def test_bvh_with_other_line_breaks_is_equal(tmp_path, text):
    expected = np.concatenate([*bvh_file.read(wrote(tmp_path, ".bvh", PLAIN.encode())).blocks()])
    motion = bvh_file.read(wrote(tmp_path, ".bvh", text.encode()))
    names = ["hips", "arm", "hand", "hand end"]
    assert [point.lower() for point in motion.points] == names
    assert np.array_equal(np.concatenate([*motion.blocks()]), expected)
    assert (motion.n_frames, motion.note) == (5, None)


def test_bvh_frames_beyond_stated_number(tmp_path):
    path = wrote(tmp_path, ".bvh", PLAIN.replace("Frames: 5", "Frames: 3").encode())
    words = "the file says 3 frames, and 2 more follow, which are not read"
    assert summary(path).note == words
    assert read(path, "hand.x", unit=0.01).damage == words


def test_bvh_arm_rotated_by_right_angle(tmp_path):
    rows = np.zeros((2, 12))
    rows[1, 6] = 90.0
    places = np.concatenate(list(bvh_file.read(wrote(tmp_path, ".bvh", files.bvh(rows))).blocks()))
    assert np.allclose(places[0, 3], [25, 10, 0])
    assert np.allclose(places[1, 3], [0, 35, 0])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "HIERACHY", "1: this is not a BVH file"),
        ("JOINT arm", "JOIN arm", "6: this line is out of place"),
        ("CHANNELS 6", "CHANNELS 5", "5: channels are a count"),
        ("OFFSET 0 10 0", "OFFSET 0 10", "8: an offset must be 3 numbers"),
        ("OFFSET 0 10 0", "OFFSET 0 nan 0", "8: an offset must be 3 numbers"),
        ("}\nMOTION", "MOTION", "a brace is not closed"),
        ("Frames: 3", "Frames: 4", "fewer frames than it says"),
        ("Frames: 3", "Frames: 999999999", "more than 20,000,000 samples"),
        ("Frame Time: 0.01", "Frame Time: 0", "above a microsecond"),
        ("Frame Time: 0.01", "Frame Time:", "35 numbers, but a frame must be 12 numbers"),
        ("Frame Time: 0.01", "Frame Time: x", "the time of a frame must be 1 numbers"),
        ("0 0 0 0 0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 0 0 0 1", "a frame must be 12 numbers"),
    ],
)
def test_bvh_malformed_files_are_refused_by_line(tmp_path, old, new, message):
    text = files.bvh(np.eye(12)[[0, 3, 11]]).decode()
    assert old in text
    path = wrote(tmp_path, ".bvh", text.replace(old, new, 1).encode())
    with pytest.raises(TakeError, match=message):
        read(path, "hand.x", unit=0.01)


# --- TRC ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
@pytest.mark.parametrize(
    "layout", [{}, {"blank": False}, {"last_tab": True}, {"end": "\r\n"}, {"rate": 59.94}]
)
def test_trc_markers_and_rate(tmp_path, unit, layout):
    places = files.curve(40)
    places[10:13, 1] = np.nan
    path = wrote(tmp_path, ".trc", files.trc(places, unit=unit, **layout))
    metres, rate = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[unit], layout.get("rate", 100.0)
    for point, name in enumerate(("RWRI", "LWRI")):
        for axis, letter in enumerate("xyz"):
            assert is_of(read(path, f"{name}.{letter}"), places, point, axis, rate, metres)
    assert read(path, "LWRI.x").damage == (
        "'LWRI' is not seen in 3 frames; a spline runs across them"
    )
    names = [column.name for column in summary(path).columns[1:]]
    assert names == [f"{name}.{axis} [m]" for name in ("RWRI", "LWRI") for axis in "xyz"]


TRC = files.trc(files.curve(3))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (TRC.replace(b"PathFileType", b"Path"), "this is not a TRC file"),
        (b"PathFileType", "this is not a TRC file"),
        (TRC.replace(b"\t2\tmm", b"\t3\tmm"), "5: its head says 3 markers, and names 2"),
        (TRC.replace(b"\t3\t2\tmm", b"\t4\t2\tmm"), "the file says 4 frames, and holds 3"),
        (TRC.replace(b"\t3\t2\tmm", b"\tx\t2\tmm"), "NumFrames in the head"),
        (TRC.replace(b"\n100\t", b"\n0\t"), "DataRate in the head"),
        (files.trc(files.curve(3), step=0.005), "100 frames a second, .* are 0.005 s apart"),
        (TRC[:-1] + b"\t1\n", "9: the number of values in this line is 9"),
        (
            TRC.replace(b"\n2\t0.01000\t", b"\n2\t0.01000\tx"),
            "8: this line is not a row of numbers",
        ),
        (TRC.replace(b"\tmm", b"\tell"), "does not state the unit"),
    ],
)
def test_trc_malformed_files_are_refused(tmp_path, data, message):
    assert data != TRC
    with pytest.raises(TakeError, match=message):
        read(wrote(tmp_path, ".trc", data), "RWRI.x")


# --- TSV ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hidden", ["0.000", "", "NULL", "NaN"])
@pytest.mark.parametrize("leading", [0, 1, 2])
@pytest.mark.parametrize("titles", [False, True])
def test_qtm_tsv_markers_and_rate(tmp_path, titles, leading, hidden):
    places = files.curve(40)
    places[20:23, 1] = np.nan
    data = files.qtm(places, titles=titles, leading=leading, hidden=hidden)
    for text in (data, data.replace(b"\n", b"\t\r\n")):
        path = wrote(tmp_path, ".tsv", text)
        for point, name in enumerate(("RWRI", "LWRI")):
            for axis, letter in enumerate("xyz"):
                assert is_of(read(path, f"{name}.{letter}"), places, point, axis)
        assert "3 frames" in (read(path, "LWRI.x").damage or "")


def test_qtm_tsv_with_other_clock_needs_rate(tmp_path):
    path = wrote(tmp_path, ".tsv", files.qtm(PLACES, rate="EXT"))
    with pytest.raises(TakeError, match="such as rate: 100Hz"):
        read(path, "RWRI.x")
    assert is_of(read(path, "RWRI.x", rate=50.0), PLACES, 0, 0, 50.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("MARKER_NAMES", "BONE_NAMES", "export 3D or 6D data with a header"),
        ("MARKER_NAMES", "BODY_NAMES", "the bodies need 32"),
        ("NO_OF_FRAMES\t12", "NO_OF_FRAMES\t13", "says 13 frames, and holds 12"),
        ("NO_OF_FRAMES\t12", "NO_OF_FRAMES\tmany", "is not a number"),
        ("FREQUENCY\t100", "FREQUENCY\t0", "is not a number above 0"),
        ("\t-", "\t-999999999999", "no camera sees"),
        ("\t-", "\tleft", "not a row of numbers"),
        ("\t-", "\t1\t", "the markers need 6"),
    ],
)
def test_qtm_tsv_malformed_files_are_refused(tmp_path, old, new, message):
    text = files.qtm(PLACES).decode()
    head, _, rest = text.rpartition(old)
    path = wrote(tmp_path, ".tsv", f"{head}{new}{rest}".encode())
    with pytest.raises(TakeError, match=message):
        read(path, "RWRI.x")


@pytest.mark.parametrize("leading", [0, 2])
@pytest.mark.parametrize("titles", [False, True])
def test_qtm_bodies_positions(tmp_path, titles, leading):
    """Where a body is stands in its first three columns; its turns are passed over."""
    places = files.curve(40)
    places[20:23, 1] = np.nan
    data = files.qtm_bodies(places, titles=titles, leading=leading)
    for text in (data, data.replace(b"\n", b"\t\r\n")):
        path = wrote(tmp_path, ".tsv", text)
        for body, name in enumerate(("RWRI", "LWRI")):
            for axis, letter in enumerate("xyz"):
                assert is_of(read(path, f"{name}.{letter}"), places, body, axis)
        assert "3 frames" in (read(path, "LWRI.x").damage or "")


# --- CSV of OptiTrack -----------------------------------------------------------------------------


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("version", [1.1, 1.25])
def test_optitrack_csv_markers_and_rate(tmp_path, version, timed):
    places = files.curve(40)
    places[20:23, 1] = np.nan
    path = wrote(tmp_path, ".csv", files.optitrack(places, version=version, timed=timed))
    for point, name in enumerate(("RWRI", "LWRI")):
        for axis, letter in enumerate("xyz"):
            assert is_of(read(path, f"Hand:{name}.{letter}"), places, point, axis)
    assert "3 frames" in (read(path, "Hand:LWRI.x").damage or "")
    body = read(path, "Board 1.x")
    assert np.allclose(body.x, 1e-3 * np.arange(40))
    lines = path.read_text(encoding="utf-8").splitlines()
    with_commas = [line + "," * bool(line) for line in lines]  # as spreadsheets save them
    path = wrote(tmp_path, ".csv", "\r\n".join(with_commas).encode())
    assert is_of(read(path, "Hand:RWRI.x"), places, 0, 0)
    with pytest.raises(TakeError, match="states its own unit"):
        read(path, "Hand:RWRI.x", unit=0.01)


def test_optitrack_csv_without_rate_or_unit(tmp_path):
    path = wrote(tmp_path, ".csv", files.optitrack(PLACES, head="Take Notes,", unit="Feet"))
    with pytest.raises(TakeError, match="such as unit: 1cm"):
        read(path, "Hand:RWRI.x")
    with pytest.raises(TakeError, match="such as rate: 100Hz"):
        read(path, "Hand:RWRI.x", unit=1e-3)
    assert is_of(read(path, "Hand:RWRI.x", rate=50.0, unit=1e-3), PLACES, 0, 0, 50.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Frame,", "Row,", "no line that begins with Frame"),
        ("Position", "Place", "no columns called Position"),
        ("Frames,12", "Frames,13", "says 13 frames, and holds 12"),
        ("Frames,12", "Frames,many", "is not a number"),
        ("Rate,100", "Rate,-1", "is not a number above 0"),
        ('"Board 1"', '"Board 1', "quotation in this line is not closed"),
        (",0,7,", ",0,7,9,", "but the header has 15 columns"),
        (",0,7,", ",0,seven,", "not a row of numbers"),
        (",0,7,", ",0,-7e99,", "no camera sees"),
    ],
)
def test_optitrack_csv_malformed_files_are_refused(tmp_path, old, new, message):
    text = files.optitrack(PLACES).decode()
    assert old in text
    count = -1 if old == "Position" else 1
    path = wrote(tmp_path, ".csv", text.replace(old, new, count).encode())
    with pytest.raises(TakeError, match=message):
        read(path, "Hand:RWRI.x")


def test_plain_tsv_columns(tmp_path):
    path = wrote(tmp_path, ".tsv", b"t [ms]\tx [cm]\n0\t0\n10\t3\n")
    assert read(path).t.tolist() == [0.0, 0.01]
    assert read(path).x.tolist() == [0.0, 0.03]


# --- SDIF -----------------------------------------------------------------------------------------


def test_columns_of_sdif_by_their_names(tmp_path):
    t = np.array([0.5, 0.52, 0.6])
    x = np.array([[1.0, 5.0, 0.0], [2.0, 4.0, 0.5], [4.0, 4.5, 1.0]])
    types = "{ 1MTD XPOS { x, y, z } 1FTD XMOV { XPOS position; } }"
    table = files.frame(b"1NVT", 0.0, files.matrix(b"1NVT", np.zeros((1, 1))))
    path = wrote(tmp_path, ".sdif", files.sdif(table, files.declared(types), files.moving(t, x)))
    for i, letter in enumerate("xyz"):
        result = read(path, f"XPOS.{letter}", unit=0.01)
        assert np.allclose(result.t, t - 0.5)
        assert np.allclose(result.x, (x[:, i] - x[0, i]) * 0.01)
    with pytest.raises(TakeError, match=r"there are XPOS\.x, XPOS\.y, XPOS\.z") as caught:
        read(path, "XPOS.a", unit=0.01)
    assert caught.value.suggestion in ("XPOS.x", "XPOS.y", "XPOS.z")
    with pytest.raises(TakeError, match="such as unit: 1cm"):
        read(path, "XPOS.x")
    with pytest.raises(TakeError, match="one of XPOS"):
        read(path, unit=0.01)


@pytest.mark.parametrize("kind", [4, 8, 0x104])
def test_sdif_channels_by_stream_and_row(tmp_path, kind):
    def packet(t: float, stream: int, x: float) -> bytes:
        return files.frame(
            b"XMOV", t, files.matrix(b"XPOS", np.array([[x], [-x]]), kind), stream=stream
        )

    path = wrote(
        tmp_path, ".sdif", files.sdif(*(packet(i, s, i * s) for i in range(3) for s in (1, 2)))
    )
    for stream in (1, 2):
        for row, sign in ((1, 1), (2, -1)):
            result = read(path, f"XPOS.1 stream {stream} row {row}", unit=0.001)
            assert np.allclose(result.x, sign * stream * np.arange(3) / 1000)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"SDIX", "not an SDIF file"),
        (files.sdif()[:7], "ends within a frame"),
        (files.sdif(), "no matrices of numbers"),
        (
            files.sdif(files.frame(b"XMOV", 0.0, files.matrix(b"A", np.ones((1, 1))))[:-1]),
            "ends with",
        ),
        (files.sdif(files.frame(b"XMOV", 0.0)[:-4] + b"\0\0\0\1"), "too short for its matrices"),
        (files.sdif(files.frame(b"XMOV", 0.0, files.matrix(b"XPOS", np.ones((40, 40))))), "1,024"),
    ],
)
def test_sdif_malformed_files_are_refused(tmp_path, data, told):
    with pytest.raises(TakeError, match=told):
        read(wrote(tmp_path, ".sdif", data), "XPOS.1", unit=0.001)
