"""Heads of SOFA files as other programs write them, beside what h5py wrote."""

from __future__ import annotations

import random
from pathlib import Path

import h5py
import numpy as np
import pytest
from sweep import few

from ergon.exchange import sofa


def _text(chance: random.Random, text: str) -> object:
    """A text as netCDF, MATLAB and h5py keep it."""
    kind = chance.choice(["fixed", "longer", "variable"])
    if kind == "variable":
        return text
    return np.bytes_(text) if kind == "fixed" else np.array(text.encode(), f"S{len(text) + 3}")


def _places(angles: np.ndarray) -> np.ndarray:
    """Azimuths, elevations [degrees] and distances as places: x to the front, y to the left."""
    az, el, r = np.radians(angles[:, 0]), np.radians(angles[:, 1]), angles[:, 2]
    return np.stack([r * np.cos(el) * np.cos(az), r * np.cos(el) * np.sin(az), r * np.sin(el)], 1)


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
        places = angles if kind == "spherical" else _places(angles)
        file.create_dataset("SourcePosition", data=places.astype(form))
        file["SourcePosition"].attrs["Type"] = _text(chance, kind)
        units = {"spherical": "degree, degree, metre", "cartesian": "metre"}
        file["SourcePosition"].attrs["Units"] = _text(chance, units[kind])
        for name in chance.sample(["ListenerView", "ReceiverPosition", "EmitterUp"], 2):
            file.create_dataset(name, data=numbers.normal(size=(2, 3, 1)))
        if chance.random() < 0.5:  # dimensions as netCDF has them
            file.create_dataset("M", data=np.zeros(n, "f4")).make_scale("M")
            file["Data.IR"].dims[0].attach_scale(file["M"])
    head = sofa.read(path)
    assert head.rate == rate
    if kind == "spherical":
        np.testing.assert_array_equal(head.angles, angles.astype(form)[:, :2])
    else:
        distances = np.full((n, 1), 1.4)
        seen = _places(np.concatenate([head.angles, distances], axis=1))
        np.testing.assert_allclose(seen, _places(angles), atol=1e-6)
    np.testing.assert_array_equal(head.responses, responses.astype(form))
    expected = np.zeros((n, 2)) if delays is None else np.broadcast_to(delays, (n, 2)) / rate
    np.testing.assert_allclose(head.delays, expected, rtol=1e-6)
