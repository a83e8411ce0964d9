"""A machine without numba computes the same bytes, and says what it lacks."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.markers import Marker
from sweep import few

ROOT = Path(__file__).parents[2]
# numba cannot be imported, as where no wheel of it fits; or it can, and what it lacks is missing.
MISSING = "sys.modules['numba'] = None"
BROKEN = """
class Broken:
    def find_spec(name, path=None, target=None):
        if name == 'llvmlite':
            raise OSError('libLLVM.so: cannot open shared object file')
sys.meta_path.insert(0, Broken)
"""


def score(laws: int) -> str:
    modules = "".join(
        f"      m{i}: {{CEL: {{M: 1g, f: {200 + i}Hz, t60: 1s}}}}\n"
        f"      l{i}: {{LNL: {{between: [k, m{i}], law: k*d + q*d**3,"
        " damping: z*v*exp(0.5 - 0.5*(v/s)**2), k: 0.1kN/m, q: 1e6N/m3, z: 0.01Ns/m, s: 0.1m/s}}\n"
        for i in range(laws)
    )
    return (
        "ergon: 1\nkeys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}\n"
        f"instruments:\n  i:\n    modules:\n{modules}    out: {{SOX: m0}}\n"
        "gestures: {g: 0mm@0 smooth 2mm@1/8}\nplayers: {p: {key: k}}\n"
        "parts: {p: [{at: 1|1, play: g}]}\nrender: {tail: 90s}\n"
    )


def ergon(preparation: str, *words: str) -> subprocess.CompletedProcess[str]:
    code = (
        f"import sys\n{preparation}\nfrom ergon.cli.app import run\n"
        f"code = run({list(words)!r})\n"
        "print('loaded', sys.modules.get('numba') is not None)\nsys.exit(code)"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


@pytest.fixture(scope="module")
def with_numba(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A score of so many laws that they are compiled, and the sound that it has with numba."""
    folder = tmp_path_factory.mktemp("laws")
    path = folder / "laws.yaml"
    path.write_text(score(30))
    done = ergon("", "render", str(path), "-o", str(folder / "with.wav"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("loaded True\n")
    return path, (folder / "with.wav").read_bytes()


@pytest.mark.parametrize("lack", few([MISSING, BROKEN], 1), ids=["missing", "broken"])
def test_render_without_numba_has_the_same_bytes(
    with_numba: tuple[Path, bytes], tmp_path: Path, lack: str
):
    path, sound = with_numba
    done = ergon(lack, "render", str(path), "-o", str(tmp_path / "without.wav"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("loaded False\n")
    assert (tmp_path / "without.wav").read_bytes() == sound


@pytest.mark.parametrize(
    ("lack", "reason"),
    [
        (MISSING, "numba is not installed"),
        (BROKEN, "numba is installed, and cannot be loaded: libLLVM.so"),
    ],
)
def test_doctor_reports_missing_numba(lack: str, reason: str):
    done = ergon(lack, "doctor", "--no-audio", "--seconds", "0.1")
    assert done.returncode == 0, done.stderr
    assert f"laws     computed step by step: {reason}" in done.stdout
    assert "pip install numba" in done.stdout


def test_numba_requirement_marker_by_platform():
    """The marker in pyproject.toml, by packaging's reading of it (PEP 508)."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (line,) = (text for text in table["project"]["dependencies"] if text.startswith("numba"))
    marker = Marker(line.partition(";")[2])

    def asks(system: str, machine: str, version: str = "3.13", maker: str = "CPython") -> bool:
        return marker.evaluate(
            {
                "sys_platform": system,
                "platform_machine": machine,
                "python_version": version,
                "platform_python_implementation": maker,
            }
        )

    assert asks("linux", "x86_64")
    assert asks("linux", "aarch64", "3.11")
    assert asks("darwin", "arm64", "3.14")
    assert asks("win32", "AMD64")
    assert not asks("darwin", "x86_64")
    assert not asks("win32", "ARM64")
    assert not asks("linux", "riscv64")
    assert not asks("linux", "x86_64", "3.15")
    assert not asks("linux", "x86_64", "3.11", "PyPy")
