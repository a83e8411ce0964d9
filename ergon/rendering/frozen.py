"""Parts of a staged piece into frozen files: a WAV file for each, and the manifest.

Which parts may be frozen is decided by `scores/staging/reach.py`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ergon.common.sound_files import WAVE
from ergon.exchange.frozen import MANIFEST_NAME, Frozen, Source, Stem, manifest_text
from ergon.exchange.safe import check_target, file_group
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import CHANNELS_MAX, Stamp, WaveFormat

from .ahead import computed_ahead
from .job import BLOCK_FRAMES
from .render import frames_of, stem_paths
from .staged import Staged


def write_frozen_parts(
    stage: Staged,
    taps: Mapping[str, Sequence[int]],
    source_facts: Source,
    folder: Path,
    progress: Callable[[int], None],
    *,
    n_frames: int,
    force: bool = False,
    threads: int = 1,
    inputs: Sequence[Path] = (),
) -> Frozen:
    """Compute `n_frames` frames of the taps of parts; all files or none.

    Raises FileRefusedError before any work when a file may not be written, DivergedError from the
    engine when a part goes non-finite.
    """
    import numpy as np

    parts_and_columns = [
        (part, tuple(tap_columns[first_column : first_column + CHANNELS_MAX]))
        for part, tap_columns in taps.items()
        for first_column in range(0, len(tap_columns), CHANNELS_MAX)
    ]
    paths = stem_paths(folder, [part for part, _ in parts_and_columns], WAVE)
    for path in (*paths, folder / MANIFEST_NAME):
        check_target(path, force=force, inputs=inputs)
    stamp = Stamp(source_facts.title, source_facts.score, source_facts.plan)
    with file_group(force=force, inputs=inputs) as output_files:
        writers = []
        for (_, tap_columns), path in zip(parts_and_columns, paths, strict=True):
            file = output_files.open(path, binary=True)
            format = WaveFormat(int(source_facts.rate), len(tap_columns), "double")
            writers.append(WaveWriter(file, format, n_frames, stamp))
        frames_done = 0
        blocks = frames_of(stage.simulation, n_frames, BLOCK_FRAMES)
        with contextlib.closing(computed_ahead(blocks) if threads > 1 else blocks) as frame_blocks:
            for tap_frames in frame_blocks:
                for writer, (_, tap_columns) in zip(writers, parts_and_columns, strict=True):
                    writer.write(np.ascontiguousarray(tap_frames[:, list(tap_columns)]))
                frames_done += len(tap_frames)
                progress(frames_done)
        for writer in writers:
            writer.close()
        stems = tuple(
            Stem(part, path, tap_columns, writer.sha256)
            for (part, tap_columns), path, writer in zip(
                parts_and_columns, paths, writers, strict=True
            )
        )
        frozen = Frozen(source_facts, n_frames, stems)
        # The manifest gets its name last.
        output_files.write(folder / MANIFEST_NAME, manifest_text(frozen).encode())
    return frozen
