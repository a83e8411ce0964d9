"""Masses, springs and contacts in miPhysics (Java), stepped by its own classes.

Its sources are not part of this project: `MIPHYSICS` names the folder `src` of a copy of
https://github.com/mi-creative/miPhysics_Processing.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benches.peers import Missing, command, program_path
from benches.sides import Floats

_DRIVER = Path(__file__).parent / "MiPhysics.java"
# The only class of Processing that its engine uses.
_STUB = (
    "package processing.core; public class PVector { public PVector(float a, float b, float c) {} }"
)
_MEMORY = "-Xmx4g"


class Program:
    """The engine and our driver, compiled."""

    def __init__(self) -> None:
        """Compile; raises Missing."""
        java, javac = program_path("java", "default-jre"), program_path("javac", "default-jdk")
        self._java = java
        sources = Path(os.environ.get("MIPHYSICS", "/nowhere"))
        engine = sources / "miPhysics" / "Engine"
        if not engine.is_dir():
            raise Missing("its sources are not here; MIPHYSICS names their folder `src`")
        self._folder = tempfile.TemporaryDirectory()
        stub = Path(self._folder.name) / "PVector.java"
        stub.write_text(_STUB)
        driver = Path(self._folder.name) / _DRIVER.name
        driver.write_text(_DRIVER.read_text())
        # javac finds the classes that these two use in the sources.
        path = ["-sourcepath", str(sources), "-d", self._folder.name, "-nowarn"]
        command([javac, *path, str(stub), str(driver)])

    def scene(
        self, lines: Iterable[str], warm: int, n_frames: int
    ) -> Callable[[], tuple[float, Floats]]:
        """A call that returns the CPU time of frames after the warm-up frames [s], and the places
        of masses.

        Lines are those of the driver; places are (n, 3) [m].
        """
        file = Path(self._folder.name) / "scene"
        file.write_text("\n".join(lines))

        def run() -> tuple[float, Floats]:
            line = [self._java, _MEMORY, "-cp", self._folder.name, "miPhysics.Engine.MiPhysics"]
            text = command([*line, str(file), str(warm), str(n_frames)])
            head, _, rest = text[text.index("took ") :].partition("\n")
            places = np.array([[float(word) for word in row.split()] for row in rest.splitlines()])
            return int(head.split()[1]) * 1e-9, places

        return run
