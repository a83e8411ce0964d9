"""Takes that a piece plays: each file is read, and its spline computed, once."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core
from ergon.notation.text.errors import Collector, quote
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import Samples, read
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import TakeFile

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(slots=True)
class Takes:
    """Takes of a piece, read and splined when first needed, unless they are in `old_takes`.

    `known_takes` gets the takes that are needed, each by the values that it is made of.
    """

    piece: Piece
    collector: Collector
    old_takes: Mapping[Hashable, _core.Take] = field(default_factory=dict)
    known_takes: dict[Hashable, _core.Take] = field(default_factory=dict)
    _takes_by_name: dict[str, _core.Take | None] = field(default_factory=dict)

    def for_piece(self, piece: Piece) -> Takes:
        """The takes of another piece, sharing the files that were read."""
        return Takes(piece, self.collector, self.old_takes, self.known_takes)

    def get(self, name: str) -> _core.Take | None:
        """The take; None if an error was reported."""
        if name not in self._takes_by_name:
            self._takes_by_name[name] = self._load(self.piece.takes[name])
        return self._takes_by_name[name]

    def _load(self, take: TakeFile) -> _core.Take | None:
        identity = _take_key(take)
        if (known_take := self.known_takes.get(identity) or self.old_takes.get(identity)) is None:
            return self._read_take(take, identity)
        self.known_takes[identity] = known_take
        return known_take

    def input_samples(self, name: str) -> NDArray[np.float64] | None:
        """The samples that an input gives without a sound card (n_frames,), full scale 1; None if
        an error was reported.

        A file at another rate is resampled by a natural quintic spline.
        """
        take, rate = self.piece.takes[name], self.piece.rate
        if take.path is None:
            return np.empty(0)
        try:
            samples = _input_channel(take, take.path)
            if samples.t[1] == 1.0 / rate:
                return samples.x
            n_frames = int(samples.t[-1] * rate) + 1
            return _core.Take(samples.t, samples.x).positions(np.arange(n_frames) / rate)
        except TakeError as error:
            self._report_error(take, error.field, error.message, error.suggestion)
        except _core.EngineError as error:
            self._report_error(take, error.module or "file", str(error))
        return None

    def _read_take(self, take: TakeFile, identity: Hashable) -> _core.Take | None:
        if take.path is None or take.input is not None:
            message = f"take {quote(take.name)} is an input: it drives an ENX or ENF, and no key"
            self.collector.error("E308", message, take.place)
            return None
        try:
            samples = read(take.path, take.channel, rate=take.rate, unit=take.unit)
            if samples.damage is not None:
                message = f"take {quote(take.name)}: {take.path.name}: {samples.damage}"
                self.collector.error("W314", message, take.places.get("file", take.place))
            engine_take = _core.Take(samples.t, samples.x, trim=take.trim, smooth=take.smooth)
            if samples.damage is None:  # damage is reported once
                self.known_takes[identity] = engine_take
            return engine_take
        except TakeError as error:
            self._report_error(take, error.field, error.message, error.suggestion)
        except _core.EngineError as error:
            self._report_error(take, error.module or "file", str(error))
        return None

    def _report_error(
        self, take: TakeFile, field: str, message: str, suggestion: str | None = None
    ) -> None:
        place = take.places.get(field, take.place)
        message = f"take {quote(take.name)}: {message}"
        self.collector.error("E310", message, place, suggestion=suggestion)


def _input_channel(take: TakeFile, path: Path) -> Samples:
    """The channel of a file for an input: the one with the input's number if there are several."""
    if take.channel is not None or take.card_channel is None:
        return read(path, take.channel)
    try:
        return read(path, str(take.card_channel))
    except TakeError as error:
        try:
            return read(path)
        except TakeError:
            raise error from None


def _take_key(take: TakeFile) -> Hashable:
    """A key for a take: as long as it is the same, the take is the same."""
    if take.path is None:
        return take.input
    try:
        file_stat = take.path.stat()
        file_identity = file_stat.st_mtime_ns, file_stat.st_size, file_stat.st_ino
    except OSError:
        file_identity = None
    return take.path, file_identity, take.channel, take.rate, take.unit, take.trim, take.smooth
