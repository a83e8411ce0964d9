"""Heads of SOFA files as other programs write them, beside what h5py wrote."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sweep import few

from ergon.exchange import sofa


def _text(chance: random.Random, text: str) -> object:
    """A text as netCDF, MATLAB, Fortran and h5py keep it."""
    longer = np.array(text.encode(), f"S{len(text) + 3}")
    in_array = np.array([text], dtype=h5py.string_dtype())
    return chance.choice([np.bytes_(text), longer, text, text + "  ", in_array, longer[None]])


def _places(angles: np.ndarray) -> np.ndarray:
    """Azimuths, elevations [degrees] and distances as places: x to the front, y to the left."""
    az, el, r = np.radians(angles[:, 0]), np.radians(angles[:, 1]), angles[:, 2]
    return np.stack([r * np.cos(el) * np.cos(az), r * np.cos(el) * np.sin(az), r * np.sin(el)], 1)


def _head(
    chance: random.Random, file: h5py.File, n: int
) -> tuple[bool, Callable[[np.ndarray], np.ndarray]]:
    """Write where the head is; whether its right ear is first, and the places of sources in the
    room by those that it hears.
    """
    is_right_first = chance.random() < 0.3
    y = -0.09 if is_right_first else 0.09
    ears = np.array([[0.0, y, 0.0], [0.0, -y, 0.0]])[:, :, None]
    if is_right_first or chance.random() < 0.5:
        ears = chance.choice([ears, np.repeat(ears, n, axis=2)])
        file.create_dataset("ReceiverPosition", data=ears)
    place, turn = np.zeros(3), np.eye(3)
    if chance.random() < 0.5:
        place = np.array([chance.uniform(-1, 1) for _ in range(3)])
        turn = Rotation.from_euler("zyx", [chance.uniform(-180, 180), 20, 30], True).as_matrix()
        for name, row in (("Position", place), ("View", turn[:, 0] * 2), ("Up", turn[:, 2])):
            rows = chance.choice([row[None], np.repeat(row[None], n, axis=0)])
            file.create_dataset(f"Listener{name}", data=rows)
            file[f"Listener{name}"].attrs["Type"] = _text(chance, "cartesian")
    return is_right_first, lambda heard: heard @ turn.T + place


@pytest.mark.parametrize("seed", few(range(40), range(16)))
def test_heads_of_other_programs(seed: int, tmp_path: Path) -> None:
    chance, numbers = random.Random(seed), np.random.default_rng(seed)
    n, taps = chance.choice([4, 12, 50]), chance.choice([8, 128, 257])
    angles = np.stack(
        [numbers.uniform(-180, 360, n), numbers.uniform(-90, 90, n), np.full(n, 1.4)], axis=1
    )
    responses = numbers.normal(size=(n, 2, taps))
    form = chance.choice(["<f8", ">f8", "<f4", ">f4"])
    rate = chance.choice([44_100.0, 48_000.0, 96_000.0])
    rates = chance.choice([np.array([rate]), np.full((n,), rate), np.array([[rate]])])
    delays = chance.choice([None, np.zeros((1, 2)), numbers.uniform(0, 20, (n, 2)).astype(form)])
    path = tmp_path / "x.sofa"
    options = chance.choice([{}, {"compression": "gzip"}, {"compression": "gzip", "shuffle": True},
                             {"chunks": (1, 2, taps), "fletcher32": True}])  # fmt: skip
    with h5py.File(path, "w", libver=chance.choice([None, "latest"])) as file:
        version = chance.choice(["0.6", "1.0", "2.1"])
        for name, text in (("Conventions", "SOFA"), ("Version", version),
                           ("SOFAConventions", "SimpleFreeFieldHRIR"), ("DataType", "FIR"),
                           ("Title", "a head")):  # fmt: skip
            file.attrs[name] = _text(chance, text)
        file.create_dataset("Data.IR", data=responses.astype(form), **options)
        file.create_dataset("Data.SamplingRate", data=rates)
        file["Data.SamplingRate"].attrs["Units"] = _text(chance, "hertz")
        if delays is not None:
            file.create_dataset("Data.Delay", data=delays)
        kind = chance.choice(["spherical", "spherical", "cartesian"])
        is_right_first, in_room = _head(chance, file, n)
        x, y, z = in_room(_places(angles)).T
        if "ListenerView" in file:
            angles_of_room = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
            written = np.stack([*angles_of_room, np.sqrt(x * x + y * y + z * z)], axis=1)
        else:
            written = angles
        places = written if kind == "spherical" else np.stack([x, y, z], axis=1)
        file.create_dataset("SourcePosition", data=places.astype(form))
        file["SourcePosition"].attrs["Type"] = _text(chance, kind)
        units = {"spherical": "degree, degree, metre", "cartesian": "metre"}
        file["SourcePosition"].attrs["Units"] = _text(chance, units[kind])
        has_view = "ListenerView" in file
        file.create_dataset("EmitterUp", data=numbers.normal(size=(2, 3, 1)))
        if chance.random() < 0.5:  # dimensions as netCDF has them
            file.create_dataset("M", data=np.zeros(n, "f4")).make_scale("M")
            file["Data.IR"].dims[0].attach_scale(file["M"])
    head = sofa.read(path)
    assert head.rate == rate
    if kind == "spherical" and not has_view:
        np.testing.assert_array_equal(head.angles, angles.astype(form)[:, :2])
    else:
        distances = np.full((n, 1), 1.4)
        seen = _places(np.concatenate([head.angles, distances], axis=1))
        np.testing.assert_allclose(seen, _places(angles), atol=1e-5)
    order = [1, 0] if is_right_first else [0, 1]
    np.testing.assert_array_equal(head.responses[:, order], responses.astype(form))
    expected = np.zeros((n, 2)) if delays is None else np.broadcast_to(delays, (n, 2)) / rate
    np.testing.assert_allclose(head.delays[:, order], expected, rtol=1e-6)


def _file(path: Path, change: Callable[[h5py.File], object]) -> Path:
    with h5py.File(path, "w") as file:
        file.attrs["SOFAConventions"] = "SimpleFreeFieldHRIR"
        file["SourcePosition"] = [(60.0 * i, 10.0, 1.4) for i in range(6)]
        file["SourcePosition"].attrs["Type"] = "spherical"
        file["SourcePosition"].attrs["Units"] = "degree, degree, metre"
        file["Data.IR"] = np.random.default_rng(1).normal(size=(6, 2, 16))
        file["Data.SamplingRate"] = [48_000.0]
        change(file)
    return path


def _with(name: str, data: object, **attributes: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        old = {**file[name].attrs} if name in file else {}
        if name in file:
            del file[name]
        file[name] = data
        for key, value in {**old, **attributes}.items():
            if value is not None:
                file[name].attrs[key] = value

    return change


_PLACES = [(60.0 * i, 10.0, 1.4) for i in range(6)]
_EARS = [[[0, 0], [0.1, -0.1], [0, 0]], [[0, 0], [-0.1, 0.1], [0, 0]]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_with("Data.SamplingRate", [48e3] * 5 + [44.1e3]), "rates from 44100 to 48000 Hz"),
        (_with("Data.SamplingRate", [48e3, np.nan]), "rates"),
        (_with("Data.SamplingRate", [44.1], Units="kilohertz"), "a rate of 44.1 Hz"),
        (_with("SourcePosition", _PLACES, Type=None, Units=None), "not said to be either"),
        (_with("SourcePosition", _PLACES, Type="spherical", Units="metre"), "one of both is wrong"),
        (_with("SourcePosition", _PLACES, Type="cartesian"), "one of both is wrong"),
        (_with("SourcePosition", [(0, 100.0, 1)] * 6), "beyond 90°"),
        (_with("SourcePosition", [(1e4, 0, 1)] * 6), "beyond 360°"),
        (_with("ListenerView", [(1.0, 0, 0)] * 4), "ListenerView is 4 by 3; expected 1 or 6 by 3"),
        (_with("ListenerView", [(0.0, 0, 1)]), "ListenerUp points where ListenerView does"),
        (_with("ListenerPosition", [(np.nan, 0, 1)]), "ListenerPosition is not finite"),
        (_with("ReceiverPosition", _EARS), "change sides"),
        (_with("ReceiverPosition", [[0, 0.1, 0]]), "ReceiverPosition has 1 rows"),
        (_with("ReceiverPosition", [[0, 0.1], [0, -0.1]]), "ReceiverPosition is 2 by 2; expected"),
        (_with("ListenerView", [(0, 90, 1)], Type="spherical"), "ListenerUp points where"),
        (_with("ListenerView", [(9, 0, 0)], Type="spherical"), "ListenerView has angles at"),
        (_with("ListenerView", [(1, 0, 0)], Units="inch"), "ListenerView is in 'inch'; degrees"),
        (_with("ListenerView", [(1, 0, 0)], Type="polar"), "ListenerView is polar, not spherical"),
        (
            _with("ReceiverPosition", [[0, 0.1, 0]] * 2, Type="cartesian", Units="degree"),
            "is wrong",
        ),
        (_with("Data.Delay", [(0, 1.0)], Units="millisecond"), "Data.Delay is in millisecond"),
        (_with("ListenerUp", np.bytes_("up")), "does not hold numbers"),
        (lambda file: file.create_dataset("ListenerView", (1 << 24, 3), "f4"), "values; at most"),
    ],
)
def test_heads_of_two_meanings_are_refused(
    change: Callable[[h5py.File], None], words: str, tmp_path: Path
) -> None:
    with pytest.raises(sofa.SofaError, match=words):
        sofa.read(_file(tmp_path / "a.sofa", change))


def test_kind_of_places_by_their_units(tmp_path: Path) -> None:
    places = _places(np.array(_PLACES))
    path = _file(tmp_path / "a.sofa", _with("SourcePosition", places, Type=None, Units="metre"))
    angles = sofa.read(path).angles
    np.testing.assert_allclose(angles[:, 0] % 360.0, [60.0 * i for i in range(6)], atol=1e-9)


_DEGREES, _RADIANS = "degree, degree, metre", "radian, radian, metre"


@pytest.mark.parametrize(
    ("scale", "attributes"),
    [
        (1.0, {"Type": "spherical", "Units": _DEGREES}),
        (1.0, {"Type": "spherical"}),
        (1.0, {"Units": "degrees,degrees,meters"}),
        (np.pi / 180.0, {"Type": "spherical", "Units": _RADIANS}),
        (np.pi / 180.0, {"Units": _RADIANS}),
    ],
)
def test_view_and_ears_in_angles(scale: float, attributes: dict[str, str], tmp_path: Path) -> None:
    """A view to the left whose `ListenerUp` has no type, and the right ear first."""
    angle_scale = np.array([scale, scale, 1.0])
    up_row = np.array([(0.0, 90.0, 1.0)]) * angle_scale

    def change(file: h5py.File) -> None:
        _with("ListenerView", np.array([(90.0, 0.0, 1.0)]) * angle_scale, **attributes)(file)
        _with("ListenerUp", up_row)(file)
        ears = np.array([(270.0, 0.0, 0.09), (90.0, 0.0, 0.09)]) * angle_scale
        _with("ReceiverPosition", ears[:, :, None], **attributes)(file)

    path = _file(tmp_path / "a.sofa", change)
    head = sofa.read(path)
    expected_azimuths = np.array([60.0 * i - 90.0 for i in range(6)])
    np.testing.assert_allclose((head.angles[:, 0] - expected_azimuths + 1.0) % 360.0, 1.0)
    np.testing.assert_allclose(head.angles[:, 1], 10.0)
    with h5py.File(path) as file:
        np.testing.assert_array_equal(head.responses[:, ::-1], file["Data.IR"])


def test_source_in_radians(tmp_path: Path) -> None:
    rows = np.radians(_PLACES) * [1, 1, 0] + [0, 0, 1.4]
    change = _with("SourcePosition", rows, Units=_RADIANS)
    angles = sofa.read(_file(tmp_path / "a.sofa", change)).angles
    np.testing.assert_allclose(angles, np.array(_PLACES)[:, :2], atol=1e-12)


@pytest.mark.parametrize(("unit", "per_metre"), [("centimetre", 100), ("mm, mm, mm", 1000)])
def test_source_in_smaller_units_than_its_listener(
    unit: str, per_metre: float, tmp_path: Path
) -> None:
    def change(file: h5py.File) -> None:
        rows = (_places(np.array(_PLACES)) + np.array([1.0, 0.0, 0.0])) * per_metre
        _with("SourcePosition", rows, Type="cartesian", Units=unit)(file)
        _with("ListenerPosition", [(1.0, 0.0, 0.0)], Type="cartesian", Units="metre")(file)

    angles = sofa.read(_file(tmp_path / "a.sofa", change)).angles
    np.testing.assert_allclose((angles - np.array(_PLACES)[:, :2] + 1.0) % 360.0, 1.0, atol=1e-9)


def test_emitter_off_its_source_is_named(tmp_path: Path) -> None:
    emitter = [[[0], [120], [0]]]
    path = _file(tmp_path / "a.sofa", _with("EmitterPosition", emitter, Units="centimetre"))
    assert sofa.read(path).passed_over[1:] == (
        "EmitterPosition, 1.2 m off: sources are read at SourcePosition",
    )


def test_delays_in_seconds_are_read_as_seconds(tmp_path: Path) -> None:
    path = _file(tmp_path / "a.sofa", _with("Data.Delay", [(0.0, 1e-3)], Units="second"))
    np.testing.assert_allclose(sofa.read(path).delays, [(0.0, 1e-3)] * 6)


def test_views_of_zeros_count_as_usual(tmp_path: Path) -> None:
    path = _file(tmp_path / "a.sofa", _with("ListenerView", [(0.0, 0.0, 0.0)]))
    np.testing.assert_array_equal(sofa.read(path).angles, np.array(_PLACES)[:, :2])


def test_several_distances_of_a_head_are_named(tmp_path: Path) -> None:
    places = [(60.0 * i, 10.0, 0.5 + i / 2) for i in range(6)]
    path = _file(tmp_path / "a.sofa", _with("SourcePosition", places))
    assert sofa.read(path).passed_over[0].startswith("distances, 0.5 to 3 m")
