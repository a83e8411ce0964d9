"""Heads from SOFA files, and what is no such file."""

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from ergon.exchange import sofa


def made(path: Path, change: Callable[[h5py.File], None] = lambda _: None) -> Path:
    with h5py.File(path, "w") as file:
        file.attrs["SOFAConventions"] = np.bytes_("SimpleFreeFieldHRIR")
        angles = [(30.0 * i, 10.0, 1.4) for i in range(12)]
        file.create_dataset("SourcePosition", data=angles)
        file["SourcePosition"].attrs["Type"] = np.bytes_("spherical")
        responses = np.random.default_rng(1).normal(size=(12, 2, 64))
        file.create_dataset("Data.IR", data=responses, compression="gzip")
        file.create_dataset("Data.SamplingRate", data=[48_000.0])
        change(file)
    return path


def test_responses_are_read(tmp_path: Path):
    found = sofa.read(made(tmp_path / "a.sofa"))
    assert (found.angles.shape, found.responses.shape, found.rate) == ((12, 2), (12, 2, 64), 48e3)
    np.testing.assert_array_equal(found.angles[1], (30.0, 10.0))
    np.testing.assert_allclose(found.responses[0, 0, 0], np.random.default_rng(1).normal())


def renamed(file: h5py.File) -> None:
    file.attrs["SOFAConventions"] = np.bytes_("GeneralTF")


def cartesian(file: h5py.File) -> None:
    file["SourcePosition"].attrs["Type"] = np.bytes_("cartesian")


def replaced(name: str, data: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        if data is not None:
            file.create_dataset(name, data=data)

    return change


def huge(file: h5py.File) -> None:
    del file["Data.IR"]
    file.create_dataset("Data.IR", shape=(1 << 20, 2, 1 << 20), dtype="f8", chunks=(1, 2, 1024))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (renamed, "GeneralTF convention"),
        (cartesian, "cartesian"),
        (huge, "values"),
        (replaced("Data.IR", None), "not a SOFA file"),
        (replaced("Data.IR", np.ones((12, 1, 64))), "2 ears"),
        (replaced("Data.IR", np.zeros((12, 2, 64))), "not all 0"),
        (replaced("Data.IR", np.full((12, 2, 64), np.nan)), "finite"),
        (replaced("SourcePosition", np.ones((3, 3))), "3 directions"),
        (replaced("Data.SamplingRate", [0.0]), "rate of 0"),
        (replaced("Data.SamplingRate", np.array([], float)), "not a SOFA file"),
    ],
)
def test_what_is_no_head_is_told(tmp_path: Path, change: Callable, words: str):
    with pytest.raises(sofa.SofaError, match=words):
        sofa.read(made(tmp_path / "a.sofa", change))


def test_other_files_are_refused(tmp_path: Path):
    path = tmp_path / "a.sofa"
    path.write_bytes(b"not HDF5 at all")
    with pytest.raises(sofa.SofaError, match="not a SOFA file"):
        sofa.read(path)
    whole = made(tmp_path / "b.sofa").read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(sofa.SofaError, match="not a SOFA file"):
        sofa.read(path)
    with pytest.raises(OSError, match="directory"):
        sofa.read(tmp_path)
    os.mkfifo(tmp_path / "c.sofa")
    with pytest.raises(OSError, match="regular"):
        sofa.read(tmp_path / "c.sofa")
