"""The end and the gain of a piece that an earlier render found by following all of it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from .mixed_stretches import KnownMaster, Outcome, stretch_key

if TYPE_CHECKING:
    from ergon.exchange.stretch_store import StretchStore

    from .job import RenderJob


class KnownMasters:
    """Ends and gains of a piece of `n_frames`, by the hash `mix` of all that its mix depends on,
    and by the level and the search for silence of a job. `score` is the hash of the score.
    """

    def __init__(self, store: StretchStore, mix_hash: str, *, n_frames: int, score: str) -> None:
        """Read nothing yet."""
        self._store, self._mix_hash, self._n_frames, self._score = store, mix_hash, n_frames, score

    def get(self, job: RenderJob) -> KnownMaster | None:
        """What is known of a job; None if it is not, or if the frames of the job are enough."""
        if not _needs_piece_end(job):
            return None
        stored = self._store.get(self._key(job))
        if stored is None:
            return None
        try:
            piece_end, gain, *fields = json.loads(stored.state)
            outcome = Outcome.from_fields(fields, self._score)
            master = None if outcome is None else KnownMaster(int(piece_end), float(gain), outcome)
        except (ValueError, TypeError, LookupError):
            return None
        return master if master is not None and is_sufficient(master, job) else None

    def put(self, job: RenderJob, master: KnownMaster) -> None:
        """Store what a job has found."""
        import numpy as np

        if _needs_piece_end(job) and is_sufficient(master, job):
            state = [master.piece_end, master.gain, *master.outcome.to_fields(self._score)]
            self._store.put(self._key(job), np.empty(0), json.dumps(state).encode())

    def _key(self, job: RenderJob) -> str:
        key_content = f"{self._mix_hash} {job.level!r} {job.format.n_channels} {job.silence_search}"
        return stretch_key("master", self._n_frames, key_content)


def _needs_piece_end(job: RenderJob) -> bool:
    """Whether the file depends on the end of the piece, or on how loud all of it is."""
    return job.level.is_levelled or job.silence_search is not None


def is_sufficient(master: KnownMaster, job: RenderJob) -> bool:
    """Whether a job needs nothing after the end of the piece: a part of it may sound on."""
    return master.piece_end > job.start and not (job.is_part and job.stop > master.piece_end)
