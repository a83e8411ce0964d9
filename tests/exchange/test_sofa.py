"""Heads from SOFA files, and what is no such file."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from ergon.exchange import sofa


def written_sofa(path: Path, change: Callable[[h5py.File], None] = lambda _: None) -> Path:
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


def test_sofa_responses_angles_and_rate(tmp_path: Path):
    result = sofa.read(written_sofa(tmp_path / "a.sofa"))
    assert (result.angles.shape, result.responses.shape, result.rate) == (
        (12, 2),
        (12, 2, 64),
        48e3,
    )
    np.testing.assert_array_equal(result.angles[1], (30.0, 10.0))
    np.testing.assert_allclose(result.responses[0, 0, 0], np.random.default_rng(1).normal())


def delayed(data: object) -> Callable[[h5py.File], None]:
    return lambda file: file.create_dataset("Data.Delay", data=data) and None


@pytest.mark.parametrize("samples", [[[3, 7.5]], np.arange(24.0).reshape(12, 2), [[-0.0, 0.0]]])
def test_sofa_delays_in_seconds(tmp_path: Path, samples: object):
    responses = sofa.read(written_sofa(tmp_path / "a.sofa", delayed(samples)))
    expected = np.ones((12, 2)) * np.asarray(samples) / 48e3
    np.testing.assert_allclose(responses.delays, expected, rtol=1e-15)


def test_delays_of_file_without_delays_are_zero(tmp_path: Path):
    assert not sofa.read(written_sofa(tmp_path / "a.sofa")).delays.any()


def renamed(file: h5py.File) -> None:
    file.attrs["SOFAConventions"] = np.bytes_("GeneralTF")


def with_unknown_places(file: h5py.File) -> None:
    file["SourcePosition"].attrs["Type"] = np.bytes_("cylindrical")


def replaced(name: str, data: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        if data is not None:
            file.create_dataset(name, data=data)

    return change


def virtual(source: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file["Data.IR"]
        layout = h5py.VirtualLayout(shape=(12, 2, 64), dtype="f8")
        layout[...] = h5py.VirtualSource(source, "Data.IR", shape=(12, 2, 64))
        file.create_virtual_dataset("Data.IR", layout)

    return change


def external(source: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file["Data.IR"]
        file.create_dataset("Data.IR", (12, 2, 64), "i1", external=[(source, 0, 12 * 2 * 64)])

    return change


def linked(link: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file.move("Data.IR", "elsewhere")
        file["Data.IR"] = link

    return change


def packed(file: h5py.File) -> None:
    responses = file["Data.IR"][...]
    del file["Data.IR"]
    file.create_dataset("Data.IR", data=responses, compression="lzf")


def huge(file: h5py.File) -> None:
    del file["Data.IR"]
    file.create_dataset("Data.IR", shape=(1 << 20, 2, 1 << 20), dtype="f8", chunks=(1, 2, 1024))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (renamed, "GeneralTF convention"),
        (with_unknown_places, "cylindrical, not spherical or cartesian"),
        (huge, "values"),
        (virtual("b.sofa"), "is virtual"),
        (virtual("."), "is virtual"),  # of itself: libhdf5 ran out of its stack, and crashed
        (external("/etc/passwd"), "is external"),
        (linked(h5py.SoftLink("/elsewhere")), "is a link"),
        (linked(h5py.ExternalLink("b.sofa", "/Data.IR")), "is a link"),
        (packed, "filter 32000"),
        (replaced("Data.IR", None), "has no Data.IR"),
        (replaced("Data.IR", np.array([b"a"] * 64)), "does not hold numbers"),
        (replaced("Data.IR", np.ones((12, 1, 64))), "2 ears"),
        (replaced("Data.IR", np.zeros((12, 2, 64))), "not all 0"),
        (replaced("Data.IR", np.full((12, 2, 64), np.nan)), "finite"),
        (replaced("SourcePosition", np.ones((3, 3))), "3 by 3 directions"),
        (replaced("Data.SamplingRate", [0.0]), "rate of 0"),
        (replaced("Data.SamplingRate", np.array([], float)), "no rate"),
        (delayed(np.zeros((3, 2))), "delays .* are 3 by 2; expected 1 or 12 by 2"),
        (delayed(np.zeros(2)), "delays .* are 2; expected"),
        (delayed([[0.0, np.nan]]), "delays"),
        (delayed([[0.0, 48e3]]), "differ by more than 0.1 s"),
        (delayed(np.array([[b"a", b"b"]])), "does not hold numbers"),
    ],
)
def test_sofa_files_without_a_usable_head_are_refused(tmp_path: Path, change: Callable, words: str):
    with pytest.raises(sofa.SofaError, match=words):
        sofa.read(written_sofa(tmp_path / "a.sofa", change))


def test_non_sofa_files_are_refused(tmp_path: Path):
    path = tmp_path / "a.sofa"
    path.write_bytes(b"not HDF5 at all")
    with pytest.raises(sofa.SofaError, match="not a SOFA file"):
        sofa.read(path)
    complete = written_sofa(tmp_path / "b.sofa").read_bytes()
    path.write_bytes(complete[: len(complete) // 2])
    with pytest.raises(sofa.SofaError, match="not a SOFA file"):
        sofa.read(path)
    with pytest.raises(OSError, match="directory"):
        sofa.read(tmp_path)
    os.mkfifo(tmp_path / "c.sofa")
    with pytest.raises(OSError, match="regular"):
        sofa.read(tmp_path / "c.sofa")


def test_external_storage_in_pipe_is_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(sofa.SofaError, match="is external"):
        sofa.read(written_sofa(tmp_path / "a.sofa", external(str(tmp_path / "pipe"))))


def test_hdf5_plugins_are_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """libhdf5 loads every library of the folder when it meets a filter that it lacks."""
    (tmp_path / "plug-ins").mkdir()
    monkeypatch.setenv("HDF5_PLUGIN_PATH", str(tmp_path / "plug-ins"))
    with pytest.raises(sofa.SofaError, match="filter 32000"):
        sofa.read(written_sofa(tmp_path / "a.sofa", packed))


def test_sofa_reader_limits_files_and_memory(tmp_path: Path):
    code = "import sofa_reader, numpy; sofa_reader.limit_process()\n"
    env = {**os.environ, "PYTHONPATH": str(Path(sofa.__file__).parent)}
    for line, error in (("open('/etc/passwd')", "OSError"), ("numpy.ones(1 << 29)", "MemoryError")):
        done = subprocess.run(
            [sys.executable, "-P", "-c", code + line], env=env, capture_output=True, text=True
        )
        assert error in done.stderr


def test_broken_answer_of_the_sofa_reader_is_reported(tmp_path: Path):
    for answer in (b"", b'{"convention"', b"\0\0\0\n"):
        with pytest.raises(sofa.SofaError, match="it is damaged"):
            sofa.responses_of(io.BytesIO(answer), tmp_path / "a.sofa")
    head = {"convention": "SimpleFreeFieldHRIR", "types": ["spherical"] * 4, "units": [""] * 4}
    shapes = [[12, 3], [12, 2, 64], [1], [1, 2]]
    line = json.dumps({**head, "shapes": shapes}).encode() + b"\n"
    with pytest.raises(sofa.SofaError, match="broke off"):
        sofa.responses_of(io.BytesIO(line + bytes(100)), tmp_path / "a.sofa")
