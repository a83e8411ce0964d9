"""Frozen parts of a session: which of them still match the score, and where their samples begin."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.exchange.frozen import MANIFEST_NAME, NotFrozenError, check
from ergon.exchange.frozen import read as read_manifest
from ergon.notation.text.files import is_below
from ergon.repl.session.journal import JournalEvent
from ergon.repl.session.struck_places import strike_points
from ergon.scores.reading.digest import digest_of, is_same
from ergon.scores.staging.frozen_content import connected_parts, frozen_content
from ergon.scores.staging.stage import RecalledOutputs

if TYPE_CHECKING:
    from ergon.exchange.frozen import Frozen
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.listening import Listening

# A session may jump, so that it keeps all samples in (locked) memory.
_BYTES_MAX = 2 << 30
_ROWS_MAX = 10_000  # parts of a folder, or stems of a part, in a journal


@dataclass(frozen=True, slots=True)
class FrozenStem:
    """A file of a part's outputs: its name, the hash of its samples, and the outputs' names."""

    file: str
    sha256: str
    outputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FrozenPart:
    """A frozen instrument: its stems, and the digest of everything that its sound depends on."""

    name: str
    content_digest: str
    stems: tuple[FrozenStem, ...]


@dataclass(frozen=True, slots=True)
class FrozenFolder:
    """The folder with the frozen parts of a session, and its name in a journal."""

    folder: Path
    parts: tuple[FrozenPart, ...]
    name: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the folder that a session reads."""
        stems = (stem.file for part in self.parts for stem in part.stems)
        return tuple(self.folder / name for name in (MANIFEST_NAME, *stems))

    def relative_to(self, journal: Path) -> FrozenFolder:
        """The same folder, with its name relative to a journal."""
        return replace(self, name=Path(os.path.relpath(self.folder, journal.parent)).as_posix())


@dataclass(frozen=True, slots=True)
class LoadedPart:
    """A frozen instrument with its samples in memory: (samples, names of their outputs)."""

    name: str
    n_frames: int
    stems: tuple[tuple[_core.FrozenOutputs, tuple[str, ...]], ...]


def frozen_folder(
    folder: Path, manifest: Frozen, piece: Piece, listening: Listening
) -> FrozenFolder:
    """The parts of a folder that was frozen from a piece. Raises NotFrozenError.

    `manifest` is the content of the folder's manifest; `listening` has the taps of the piece.
    """
    for frozen_part in manifest.parts:
        part_taps = [
            tap for stem in manifest.stems if stem.part == frozen_part for tap in stem.taps
        ]
        if part_taps != listening.taps(frozen_part):
            raise NotFrozenError(f"'{frozen_part}' has other outputs in the score")
    frozen_parts = tuple(
        FrozenPart(
            name,
            digest_of(frozen_content(piece, name)),
            tuple(
                FrozenStem(
                    stem.path.name, stem.sha256, tuple(listening.outputs[tap] for tap in stem.taps)
                )
                for stem in manifest.stems
                if stem.part == name
            ),
        )
        for name in manifest.parts
    )
    return FrozenFolder(folder, frozen_parts)


def load_frozen(
    frozen: FrozenFolder, version: Version, real_players: Collection[str]
) -> tuple[LoadedPart, ...]:
    """The parts that a version can play from their frozen samples, with these samples.

    `real_players` are the players whose hands are real. Raises NotFrozenError.
    """
    manifest = read_manifest(frozen.folder)
    stem_by_file = {stem.path.name: stem for stem in manifest.stems}
    for frozen_part in frozen.parts:
        for stem in frozen_part.stems:
            manifest_stem = stem_by_file.get(stem.file)
            expected_stem = stem.sha256, frozen_part.name, len(stem.outputs)
            if (
                manifest_stem is None
                or (manifest_stem.sha256, manifest_stem.part, len(manifest_stem.taps))
                != expected_stem
            ):
                raise NotFrozenError(
                    f"{frozen.folder} holds other frozen parts than those of this session"
                )
    n_bytes = sum(8 * manifest.n_frames * len(stem.taps) for stem in manifest.stems)
    if n_bytes > _BYTES_MAX:
        raise NotFrozenError(
            f"{frozen.folder} holds {n_bytes / 2**30:.1f} GiB, and a session, which holds them in "
            f"memory, takes {_BYTES_MAX >> 30} GiB; `ergon play --frozen` reads them from the disk"
        )
    verified_stems = {stem.path.name: stem for stem in check(manifest, {}, 0)}
    loaded_parts = []
    for frozen_part in frozen.parts:
        is_unchanged = frozen_part.name in version.sounding.instruments and (
            digest_of(frozen_content(version.sounding, frozen_part.name))
            == frozen_part.content_digest
        )
        if not is_unchanged or _is_acted_on(version, frozen_part.name, real_players):
            continue
        stems = tuple(
            (_core.FrozenOutputs(verified_stems[stem.file].samples()), stem.outputs)
            for stem in frozen_part.stems
        )
        loaded_parts.append(LoadedPart(frozen_part.name, manifest.n_frames, stems))
    return tuple(loaded_parts)


def unchanged_parts(
    loaded_parts: Sequence[LoadedPart],
    old_version: Version,
    version: Version,
    real_players: Collection[str],
) -> tuple[LoadedPart, ...]:
    """The parts whose sound a version does not change against the version before."""
    return tuple(
        part
        for part in loaded_parts
        if part.name in version.sounding.instruments
        and is_same(
            frozen_content(old_version.sounding, part.name),
            frozen_content(version.sounding, part.name),
        )
        and not _is_acted_on(version, part.name, real_players)
    )


def place_samples(
    loaded_parts: Sequence[LoadedPart], listening: Listening, clock: Clock, rate: float
) -> tuple[RecalledOutputs, ...]:
    """The samples of parts, placed on the running piece; none while it is stopped."""
    if clock.begin_instant is None:
        return ()
    begin_frame = math.floor(clock.begin_instant * rate + 0.5)
    taps_by_output: dict[str, list[int]] = {}
    for part in loaded_parts:
        for tap in listening.taps(part.name):
            taps_by_output.setdefault(listening.outputs[tap], []).append(tap)
    return tuple(
        RecalledOutputs(
            samples, tuple(taps_by_output[name].pop(0) for name in output_names), begin_frame
        )
        for part in loaded_parts
        for samples, output_names in part.stems
    )


def _is_acted_on(version: Version, part_name: str, real_players: Collection[str]) -> bool:
    """Whether a real hand or a MIDI note acts on the part, or on a part that is joined with it."""
    piece = version.sounding
    parts = connected_parts(piece, part_name)
    has_hand = any(
        piece.players[name].key in parts for name in real_players if name in piece.players
    )
    return has_hand or any(part_name in parts for part_name, *_ in strike_points(version))


# --- in a journal ---------------------------------------------------------------------------------


def frozen_fields(frozen: FrozenFolder) -> dict[str, object]:
    """The fields of the journal's first event."""
    part_fields = [
        {
            "part": part.name,
            "content": part.content_digest,
            "stems": [
                {"file": stem.file, "sha256": stem.sha256, "outputs": list(stem.outputs)}
                for stem in part.stems
            ],
        }
        for part in frozen.parts
    ]
    return {"frozen": frozen.name, "frozen_parts": part_fields}


def read_frozen_folder(
    first_event: JournalEvent, journal: Path, *, trust: bool
) -> FrozenFolder | None:
    """The frozen parts named by a journal's first event; None if there are none.

    Raises JournalError, also if they lie outside both the journal's folder and the current one,
    and the journal is not trusted (`trust`).
    """
    if "frozen" not in first_event.fields:
        return None
    folder_name = first_event.get("frozen", str)
    if not folder_name or "\0" in folder_name:
        first_event.refuse("the field 'frozen' is not the name of a folder")
    folder = journal.parent / folder_name
    if not trust and not any(
        is_below(folder, allowed_folder) for allowed_folder in (Path(), journal.parent)
    ):
        first_event.refuse(
            f"its frozen parts are in {folder_name!a}, outside this folder and the journal's; "
            "--trust reads them"
        )
    return FrozenFolder(
        folder,
        tuple(_read_part(row) for row in _read_rows(first_event, "frozen_parts")),
        folder_name,
    )


def _read_part(part_event: JournalEvent) -> FrozenPart:
    stems = tuple(
        FrozenStem(stem.get("file", str), stem.get("sha256", str), _read_output_names(stem))
        for stem in _read_rows(part_event, "stems")
    )
    return FrozenPart(part_event.get("part", str), part_event.get("content", str), stems)


def _read_output_names(stem_event: JournalEvent) -> tuple[str, ...]:
    output_names = stem_event.get("outputs", list)
    if not all(isinstance(name, str) for name in output_names):
        stem_event.refuse("the field 'outputs' has the wrong type or value")
    return tuple(output_names)


def _read_rows(journal_event: JournalEvent, rows_name: str) -> list[JournalEvent]:
    rows = journal_event.get(rows_name, list)
    if len(rows) > _ROWS_MAX or not all(isinstance(row_value, dict) for row_value in rows):
        journal_event.refuse(f"the field '{rows_name}' has the wrong type or value")
    return [
        JournalEvent(journal_event.file, journal_event.number, journal_event.name, row_value)
        for row_value in rows
    ]
