"""`ergon motion export`: a motion file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .motion_info import read
from .outcome import Refused
from .units import seconds_text

if TYPE_CHECKING:
    from typing import BinaryIO

    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Motion

_FORMS = (".csv", ".npz", ".gltf")


@click.command()
@click.argument("file", metavar="FILE")
@options.target("The file to write: .npz, .csv or .gltf, by its ending; - writes CSV to stdout.")
@click.option(
    "--fps",
    type=options.Number(0.1, 192_000.0),
    help="Instants a second; between looks of the engine free oscillations are exact.",
)
@click.option(
    "--exaggeration",
    type=options.Number(1e-6, 1e12),
    help="How many times as far as it moves a point of a glTF moves. Default: 5 cm at most. "
    "Points in space move as far as they do.",
)
@options.dry_run
@options.force
@options.with_console
def export(
    console: Console,
    file: str,
    output: str | None,
    fps: float | None,
    exaggeration: float | None,
    dry: bool,
    force: bool,
) -> None:
    """Write a motion file as npz, CSV or glTF.

    npz and CSV hold the displacement of every point at every instant [m]; empty, or NaN, is a value
    that was not computed; npz also holds where points in space are, each as one. glTF 2.0 holds an
    animated node for each point, for Blender and its like.
    """
    from ergon.exchange.motion import instants, read_manifest
    from ergon.exchange.motion_space import NotMotionError, points_of_parts
    from ergon.exchange.safe import check_target, open_for_writing

    if output is None:
        raise Refused("name the file to write, by -o x.npz, x.csv or x.gltf")
    file_ending = ".csv" if output == "-" else Path(output).suffix.lower()
    if file_ending not in _FORMS:
        raise Refused(f"{output}: a motion file is exported as {', '.join(_FORMS)}")
    if exaggeration is not None and file_ending != ".gltf":
        raise Refused("--exaggeration is for glTF; npz and CSV hold metres")
    motion = read(Path(file))
    input_files = (Path(file),)
    try:
        frame_instants = instants(motion, fps)
        point_count = sum(points_of_parts(read_manifest(motion), motion.names))
        if dry:
            check_target(Path(output), force=force, inputs=input_files)
        else:
            with open_for_writing(
                output, binary=file_ending == ".npz", force=force, inputs=input_files
            ) as output_file:
                _write(output_file, motion, file_ending, frame_instants, exaggeration)
    except NotMotionError as error:
        raise Refused(f"{file}: {error}") from None
    if output == "-":
        return
    n_instants = len(frame_instants)
    if console.json:
        console.record(
            "would_write" if dry else "wrote", file=output, points=point_count, instants=n_instants
        )
    else:
        verb = "would write" if dry else "wrote"
        duration_text = seconds_text(motion.duration)
        console.say(
            f"{verb} {output}: {point_count:,} points at {n_instants:,} instants, {duration_text}"
        )


def _write(
    output_file: BinaryIO,
    motion: Motion,
    file_ending: str,
    frame_instants: NDArray[np.float64],
    exaggeration: float | None,
) -> None:
    from ergon.exchange.gltf import gltf_text
    from ergon.exchange.motion import csv_rows, write_npz

    if file_ending == ".npz":
        write_npz(output_file, motion, frame_instants)
    elif file_ending == ".gltf":
        output_file.write(gltf_text(motion, frame_instants, exaggeration).encode())
    else:
        for text in csv_rows(motion, frame_instants):
            output_file.write(text.encode())
