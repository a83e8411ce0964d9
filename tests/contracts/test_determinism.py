"""Same scene, same bytes: whatever instructions the C library and numpy choose on the machine."""

import sys

import pytest
from fresh import PLAIN_GLIBC, digest, disabled

SCRIPT = """
import hashlib, sys
from oracle.core import play, simulation
from oracle.scenes import complete_scene
out = play(simulation(complete_scene(0.5), 44100.0), 22050, int(sys.argv[1]))
print(hashlib.sha256(out.tobytes()).hexdigest(), float(abs(out).max()) > 0.0)
"""
MATHS = """
import hashlib, struct, sys
from ergon import _core
found = []
for i in range(1, 4000):
    x = i * 0.00737
    found += [_core.ln(x), _core.exp(x), _core.exp(-x), _core.pow(x, 1.7), _core.decibels(x - 15)]
print(hashlib.sha256(struct.pack(f"{len(found)}d", *found)).hexdigest(), len(found) > 0)
"""


@pytest.fixture(scope="module")
def reference() -> str:
    return digest(SCRIPT, "22050")


def test_same_scene_same_bytes_again(reference: str):
    assert digest(SCRIPT, "64") == reference


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="GLIBC_TUNABLES is glibc's")
def test_digest_without_libc_vector_instructions(reference: str):
    assert digest(SCRIPT, "997", GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA") == reference
    assert digest(SCRIPT, "997", GLIBC_TUNABLES=PLAIN_GLIBC) == reference


def test_digest_without_numpy_vector_instructions(reference: str):
    off = disabled()
    if not off:
        pytest.skip("numpy dispatches nothing on this machine")
    assert digest(SCRIPT, "22050", NPY_DISABLE_CPU_FEATURES=off) == reference


def test_digest_without_any_vector_instructions(reference: str):
    tuned = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"}
    assert digest(SCRIPT, "22050", NPY_DISABLE_CPU_FEATURES=disabled(), **tuned) == reference


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="GLIBC_TUNABLES is glibc's")
def test_core_maths_independent_of_libc():
    plain = digest(MATHS)
    assert digest(MATHS, GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA") == plain
    assert digest(MATHS, GLIBC_TUNABLES=PLAIN_GLIBC) == plain
