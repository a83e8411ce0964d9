"""Plain loops in C, and a mesh's in Rust, compiled in the run that measures them."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

_MESH = Path(__file__).parent / "rust" / "mesh.rs"
# The engine's build options; it chooses the vector width at run time.
_RUSTC = (
    "rustc", "--edition", "2024", "--crate-type", "cdylib", "-C", "opt-level=3",
    "-C", "codegen-units=1", "-C", "panic=abort", "--check-cfg", "cfg(single)",
)  # fmt: skip
_SOURCES = sorted((Path(__file__).parent / "c").glob("*.c"))
# -march=native: the reference may use every feature of the machine; no contraction, so that sums
# are the same.
FLAGS = ("-O3", "-march=native", "-ffp-contract=off")


def compiler() -> str | None:
    """The C compiler of this machine; None where there is none."""
    return shutil.which("cc")


class Loops:
    """The loops of `c/`, called with numpy arrays."""

    def __init__(self) -> None:
        """Compile; raises where the compiler fails."""
        cc = compiler()
        assert cc is not None
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "loops.so"
            command = [cc, *FLAGS, "-shared", "-fPIC", *map(str, _SOURCES), "-o", str(library)]
            subprocess.run(command, check=True)
            self._library = ctypes.CDLL(str(library))

    def has(self, name: str) -> bool:
        """Whether this processor has the instructions for which the loop is written."""
        return hasattr(self._library, name)

    def call(self, name: str, *arguments: Any) -> None:
        """Call a loop: arrays by their address, ints as int64, floats as double."""
        getattr(self._library, name)(*(_argument(value) for value in arguments))


class RustMesh:
    """The loops of `rust/mesh.rs` for one type."""

    def __init__(self, *, is_single: bool) -> None:
        """Compile; raises where there is no `rustc`, or it fails."""
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "mesh.so"
            cfg = ["--cfg", "single"] if is_single else []
            subprocess.run([*_RUSTC, *cfg, str(_MESH), "-o", str(library)], check=True)
            self._library = ctypes.CDLL(str(library))

    def call(self, *arguments: Any) -> None:
        """Advance some frames: arrays by their address, ints as int64."""
        self._library.mesh(*(_argument(value) for value in arguments))


def _argument(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        return ctypes.c_void_p(value.ctypes.data)
    if isinstance(value, np.float32):
        return ctypes.c_float(float(value))
    return ctypes.c_double(value) if isinstance(value, float) else ctypes.c_int64(value)
