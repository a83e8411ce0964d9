"""Options that several calls share; each has a default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import OptionError

if TYPE_CHECKING:
    from ergon.exchange.plan_file import PlanFile
    from ergon.scores.reading.piece import Accuracy


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """How a score is read.

    `text` is the text of the score; its path then gives only its name and folder. With `trust` a
    score may name files outside its folder.
    """

    text: str | None = None
    trust: bool = False


def check_seed(seed: int | None) -> None:
    """Refuse a seed that no score can have. Raises OptionError."""
    from ergon.scores.reading.sections import MAX_SEED

    if seed is not None and not 0 <= seed <= MAX_SEED:
        reason = f"a seed is a whole number from 0 to {MAX_SEED:,}"
        raise OptionError("seed", reason, value=str(seed))


@dataclass(frozen=True, slots=True, kw_only=True)
class AccuracyOptions(ReadOptions):
    """How exactly a score is computed; None leaves a value to the score.

    At most one of three is given: `method` ("ca", "modal", "ca2p", "bm4", "ieq"),
    `error`, the largest error of the waveform (-60.0 [dB] or "-60dB"), and `cents`, the largest
    error of a pitch. `plan` is the file of an earlier plan, which is followed. A `draft` is
    computed by the cheapest methods that are stable, without trials. `seed` is the seed of every
    chance operation.
    """

    method: str | None = None
    error: float | str | None = None
    cents: float | None = None
    plan: Path | str | None = None
    draft: bool = False
    seed: int | None = None

    def accuracy(self, of_score: Accuracy, followed: PlanFile | None = None) -> Accuracy:
        """The accuracy that a piece is computed with. Raises OptionError.

        What is asked for here comes first, then what a plan that is `followed` was made for.
        """
        from ergon.notation.text.spelling import nearest
        from ergon.scores.reading.piece import METHODS, Accuracy
        from ergon.scores.staging.planning import requested_accuracy

        check_seed(self.seed)
        given = {"method": self.method, "error": self.error, "cents": self.cents}
        names = [name for name, value in given.items() if value is not None]
        if len(names) > 1:
            advice = "; give one of method, error and cents"
            raise OptionError(names[1], advice, excludes=names[0])
        if self.draft and (names or self.plan is not None):
            other = names[0] if names else "plan"
            raise OptionError("draft", ": a draft has no accuracy; leave one out", excludes=other)
        if self.method is not None and self.method not in METHODS:
            close = nearest(self.method, METHODS)
            asked = f"; did you mean '{close}'?" if close else f": {', '.join(METHODS)}"
            raise OptionError("method", f"there is no '{self.method}'{asked}")
        if not names and followed is not None and followed.budget is not None:
            method = followed.budget.get("method")
            if method is not None and method not in METHODS:
                raise OptionError("plan", f"there is no method '{method}'", value=str(self.plan))
            return Accuracy(**followed.budget, cpu=of_score.cpu)  # type: ignore[arg-type]
        return requested_accuracy(
            of_score, method=self.method, error=self._error_db(), cents=self.cents
        )

    def _error_db(self) -> float | None:
        from ergon.notation.tables.quantities import ERROR, quantity
        from ergon.notation.text.errors import TextError

        if self.error is None:
            return None
        written = self.error if isinstance(self.error, str) else f"{self.error}dB"
        try:
            return quantity(written, ERROR)
        except TextError as found:
            raise OptionError("error", found.message) from None

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that are read in addition to the score's."""
        return () if self.plan is None else (Path(self.plan),)

    def followed(self) -> PlanFile | None:
        """The earlier plan, if one is to be followed. Raises OptionError."""
        from ergon.exchange.plan_file import NotPlanError, read

        if self.plan is None:
            return None
        try:
            return read(Path(self.plan))
        except NotPlanError as error:
            raise OptionError("plan", str(error), value=str(self.plan)) from None


@dataclass(frozen=True, kw_only=True)
class PerformanceOptions:
    """How a score is played on hardware.

    `live` lists PLAYER=DEVICE, the devices under the players' keys. With `unchecked` the
    directions of motors are not tried first. `force_max` [N] is the largest force on a hand.
    `audio` says where the sound goes: "jack[:PORTS]", "pulse[:SINK]", "file:PATH", "null" or
    "auto". `audio_in` says where inputs are heard: "jack[:PORTS]", "pulse[:SOURCE]", "none" or
    "auto". The sound card takes `block` frames at a time, and `ahead` frames are computed before
    it asks for them. `gain` ("-12dB") is the gain of the sound; without it one is measured by
    computing the piece unheard. `to` folds the loudspeakers of the score's layout as
    `FoldOptions.to` does, with the `head` of a SOFA file if it is binaural. With `view`, pages
    in browsers show what is played; `view_at` (HOST:PORT) says where they are served, and `see`
    "all" also computes parts that nobody hears.
    """

    live: Sequence[str] = ()
    unchecked: bool = False
    force_max: float | None = None
    audio: str = "auto"
    audio_in: str = "auto"
    block: int | None = None
    ahead: int | None = None
    gain: str | None = None
    to: str | None = None
    head: str | Path | None = None
    view: bool = False
    view_at: str | None = None
    see: str | None = None

    @property
    def card(self) -> str:
        """Where the sound goes, with the size of its blocks."""
        return self.audio if self.block is None else f"{self.audio},block={self.block}"


@dataclass(frozen=True, kw_only=True)
class SessionOptions(PerformanceOptions):
    """How a session is opened.

    `journal` is the file that keeps every line. `resume` is an earlier journal, whose session
    continues where it ends. With `watch` the score is read again whenever it is saved. With a
    `socket` (a path; "" is the default path) the engine is a process of its own. With `trust` a
    score may name files outside its folder. `midi` lists MIDI inputs by name, or "virtual".
    `midi_clock_from` is an input whose clock is followed, `midi_clock_to` an output that gets one.
    `frozen` is a folder of parts that were computed beforehand.
    OSC requests are accepted at `osc` ([HOST:]PORT), and OSC messages go to `osc_to` (HOST:PORT).
    """

    journal: Path | str = Path("session.jsonl")
    resume: Path | str | None = None
    frozen: Path | str | None = None
    watch: bool = False
    socket: str | None = None
    trust: bool = False
    midi: Sequence[str] = ()
    midi_clock_from: str | None = None
    midi_clock_to: str | None = None
    osc: str | None = None
    osc_to: str | None = None
