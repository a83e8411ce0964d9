"""Faust programs as C libraries: compiled once, kept in out/, run in our own process."""

from __future__ import annotations

import ctypes
import hashlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benches.peers import Missing, command, program_path

_HERE = Path(__file__).parent
_BUILD_FOLDER = _HERE.parent.parent / "out" / "benches"
FLAGS = ["-O3", "-march=native"]


class Program:
    """`NAME.dsp` with the numbers it imports as `numbers.lib`, in double precision."""

    def __init__(self, name: str, numbers: Mapping[str, float | int]) -> None:
        """Compile, unless the same was compiled before (minutes); raises Missing."""
        faust, cxx = program_path("faust", "faust"), program_path("g++", "g++")
        written = "".join(f"{key} = {value!r};\n" for key, value in numbers.items())
        sources = [_HERE / "faust.cpp", _HERE / f"{name}.dsp"]
        versions = command([faust, "--version"]) + command([cxx, "--version"])
        output = "".join([versions, written, *FLAGS, *(path.read_text() for path in sources)])
        folder = _BUILD_FOLDER / f"{name}-{hashlib.sha256(output.encode()).hexdigest()[:16]}"
        library = folder / "program.so"
        if not library.is_file():
            print(f"compiling {name}.dsp: once, a minute or two", file=sys.stderr, flush=True)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "numbers.lib").write_text(written)
            code, fresh = folder / "program.cpp", folder / "fresh.so"
            places = ["-I", str(folder), "-a", str(sources[0]), "-o", str(code)]
            command([faust, "-double", "-lang", "cpp", *places, str(sources[1])])
            width = ["-DFAUSTFLOAT=double", "-shared", "-fPIC"]
            command([cxx, *FLAGS, *width, str(code), "-o", str(fresh)])
            fresh.replace(library)
        try:
            self._library = ctypes.CDLL(str(library))
        except OSError as error:
            raise Missing(f"`faust` made what cannot be loaded: {error}") from None
        self._library.begin.restype = ctypes.c_void_p
        self._library.play.restype = ctypes.c_double

    def begin(self, rate: float) -> Callable[[int], NDArray[np.float64]]:
        """Start from the beginning; returns a call that advances n_frames and returns (n_frames,
        n_outputs).
        """
        library = self._library
        built = ctypes.c_void_p(library.begin(ctypes.c_int64(int(rate))))

        class Held:  # frees what was made when nobody can go on with it
            def __del__(self) -> None:
                library.end(built)

        held = Held()
        n_outputs = int(library.outputs(built))

        def compute(n_frames: int) -> NDArray[np.float64]:
            assert held is not None
            out = np.empty((n_outputs, n_frames))
            library.compute(built, ctypes.c_int64(n_frames), ctypes.c_void_p(out.ctypes.data))
            return out.T

        return compute

    def voices(self, rate: float, count: int) -> Callable[[int], float]:
        """Start `count` voices; returns a call that advances all of them by n_frames, a multiple of
        256, and returns the peak of their sum.
        """
        library = self._library
        begun = [library.begin(ctypes.c_int64(int(rate))) for _ in range(count)]
        voices = (ctypes.c_void_p * count)(*begun)

        def play(n_frames: int) -> float:
            peak = library.play(voices, ctypes.c_int64(count), ctypes.c_int64(n_frames))
            return float(peak)

        return play
