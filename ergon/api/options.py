"""Options of calls, each declared once: the command line makes its own from these fields."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.option import Choice, Integer, Number, Text, documented, option, renamed
from ergon.common.option import Path as PathTo
from ergon.exchange.wave_header import CHANNELS_MAX

from .errors import OptionError

if TYPE_CHECKING:
    from ergon.exchange.plan_file import PlanFile
    from ergon.exchange.wave_header import Bits
    from ergon.scores.reading.outputs import Accuracy


THREADS = min(2, os.cpu_count() or 1)  # one simulates, one mixes and writes
_BLOCK_FRAMES_MAX = 1 << 20  # frames: 24 s; more takes memory and gains nothing


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """How a score is read.

    `text` is the text of the score; its path then gives only its name and folder.
    """

    text: str | None = None
    trust: bool = option(False, "Allow the score to name files outside its folder.")


def check_seed(seed: int | None) -> None:
    """Refuse a seed that no score can have. Raises OptionError."""
    from ergon.scores.reading.sections import MAX_SEED

    if seed is not None and not 0 <= seed <= MAX_SEED:
        reason = f"a seed is a whole number from 0 to {MAX_SEED:,}"
        raise OptionError("seed", reason, value=str(seed))


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class AccuracyOptions(ReadOptions):
    """How exactly a score is computed; None leaves a value to the score.

    At most one of `method`, `error` (-60.0 [dB] or "-60dB") and `cents` is given.
    """

    method: str | None = option(
        None, "Compute all parts by one method: ca, modal, ca2p, bm4 or ieq.", metavar="NAME"
    )
    error: float | str | None = option(
        None,
        "Largest error of the waveform, below the sound's own level, such as -60dB.",
        metavar="LEVEL",
    )
    cents: float | None = option(None, "Largest error of a pitch, in cents.", Number(0.01, 1200))
    plan: Path | str | None = option(
        None, "Compute by the plan in this file (from `ergon plan -o`).", metavar="FILE"
    )
    draft: bool = option(
        False,
        "Begin at once, by the cheapest methods that are stable; the accuracy is not searched.",
    )
    seed: int | None = option(
        None, "Seed of every chance operation, instead of the score's.", Integer()
    )

    def accuracy(self, score_accuracy: Accuracy, followed: PlanFile | None = None) -> Accuracy:
        """The accuracy that a piece is computed with. Raises OptionError.

        What is asked for here comes first, then what a plan that is `followed` was made for.
        """
        from ergon.notation.text.spelling import nearest
        from ergon.scores.reading.outputs import METHODS, Accuracy
        from ergon.scores.staging.planning import requested_accuracy

        check_seed(self.seed)
        options_by_name = {"method": self.method, "error": self.error, "cents": self.cents}
        written_options = [name for name, value in options_by_name.items() if value is not None]
        if len(written_options) > 1:
            advice = "; give one of method, error and cents"
            raise OptionError(written_options[1], advice, excludes=written_options[0])
        if self.draft and (written_options or self.plan is not None):
            contrary_option = written_options[0] if written_options else "plan"
            raise OptionError(
                "draft", ": a draft has no accuracy; leave one out", excludes=contrary_option
            )
        if self.method is not None and self.method not in METHODS:
            nearest_method = nearest(self.method, METHODS)
            hint = (
                f"; did you mean '{nearest_method}'?"
                if nearest_method
                else f": {', '.join(METHODS)}"
            )
            raise OptionError("method", f"there is no '{self.method}'{hint}")
        if not written_options and followed is not None and followed.budget is not None:
            method = followed.budget.get("method")
            if method is not None and method not in METHODS:
                raise OptionError("plan", f"there is no method '{method}'", value=str(self.plan))
            return Accuracy(**followed.budget, cpu=score_accuracy.cpu)  # type: ignore[arg-type]
        return requested_accuracy(
            score_accuracy, asked_method=self.method, error=self._error_db(), cents=self.cents
        )

    def _error_db(self) -> float | None:
        from ergon.notation.tables.quantities import ERROR, quantity
        from ergon.notation.text.errors import TextError

        if self.error is None:
            return None
        error_text = self.error if isinstance(self.error, str) else f"{self.error}dB"
        try:
            return quantity(error_text, ERROR)
        except TextError as error:
            raise OptionError("error", error.message) from None

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


@renamed(to="until")
@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class RenderOptions(AccuracyOptions):
    """What is rendered of a score; None leaves a value to the score.

    `bits` (16, 24 or "float") decide the level too: "float" is in SI units if the score gives no
    level, and is not high-passed. `on`, `threads` and `block` change no sample.
    """

    from_: str | None = option(
        None,
        "First position to write, such as '3|1' (in quotes), B+2 or 12.5s.",
        metavar="POSITION",
    )
    until: str | None = option(None, "Position to write up to.", metavar="POSITION")
    only: str | None = option(
        None,
        "Hear these instruments alone; all others move, silent.",
        metavar="NAME[,NAME]",
    )
    except_: str | None = option(None, "Hear all instruments but these.", metavar="NAME[,NAME]")
    channels: int | None = option(
        None,
        "Channels of the file; with n, channel c of the piece goes to channel c modulo n.",
        Integer(1, CHANNELS_MAX),
    )
    bits: Bits | None = option(
        None,
        "Bits of a sample, or float; without this option as the score says.",
        Choice((16, 24, "float")),
    )
    rate: float | None = option(
        None,
        "Frames a second of the file [Hz], instead of the score's; the physics stay the same.",
        Number(1_000, 768_000, "RATE"),
    )
    threads: int = option(
        THREADS,
        "Number of threads; the bytes are the same for any number.",
        Integer(1, 1024),
    )
    block: int = option(
        4096,
        "Frames computed at once; the bytes are the same for any number.",
        Integer(1, _BLOCK_FRAMES_MAX),
    )
    hands: Path | str | None = option(
        None,
        "Play the live hands of this recording (from `ergon duet --record`), at its level.",
        metavar="FILE.take",
    )
    input: Path | str | None = option(
        None,
        "Let inputs hear this file (from `ergon play --record-input`), at the level of `play`.",
        metavar="FILE.wav",
    )
    on: str | None = option(
        None,
        "Share the work: local:N processes here, or the Dask scheduler tcp://HOST:PORT.",
        metavar="WHERE",
    )

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that are read in addition to the score's."""
        option_paths = (self.plan, self.hands, self.input)
        return tuple(Path(option_path) for option_path in option_paths if option_path is not None)


@renamed(to="until")
@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class FileOptions(RenderOptions):
    """What is rendered of a score into files."""

    stems: Path | str | None = option(
        None,
        "Also write one file for each player or instrument, into this folder.",
        PathTo("folder"),
        metavar="DIR",
    )
    wet: bool = option(
        False,
        "Of instruments that rooms hear, write two stems: dry, and wet (the answer of the rooms).",
    )
    force: bool = option(
        False, "Also overwrite files that ergon did not write, or that were edited since."
    )
    motion: bool = option(False, "Also write what moves, beside the WAV file as FILE.motion.")
    see: str | None = option(
        None,
        "What --motion shows; all also computes parts that are not heard.",
        Choice(("all",)),
    )


@documented
@dataclass(frozen=True, kw_only=True)
class PerformanceOptions:
    """How a score is played on hardware.

    Without `gain` one is measured by computing the piece unheard.
    """

    live: Sequence[str] = option(
        (),
        "Play a player's key by a device, such as remi=firefader:/dev/ttyACM0#1, or without one, "
        "such as remi=page:; repeatable.",
        metavar="PLAYER=DEVICE",
    )
    drive: Sequence[str] = option(
        (),
        "Move the real key along the player's written part, by the force that the calibration of "
        "the key in the score says; otherwise as --live; repeatable.",
        metavar="PLAYER=DEVICE",
    )
    unchecked: bool = option(False, "Do not try the direction of each motor before it plays.")
    force_max: float | None = option(None, "Largest force on a hand [N].", Number(0, 200, "FORCE"))
    audio: str = option(
        "auto",
        "Where the sound goes: jack[:PORTS], pulse[:SINK], file:PATH, null or auto.",
        metavar="WHERE",
        shown=True,
    )
    audio_in: str = option(
        "auto",
        "Where inputs are heard: jack[:PORTS], pulse[:SOURCE], none or auto.",
        metavar="WHERE",
        shown=True,
    )
    block: int | None = option(
        None, "Frames that the sound card takes at a time.", Integer(16, 8192)
    )
    ahead: int | None = option(
        None, "Frames computed before the sound card asks for them.", Integer(64, 1 << 20)
    )
    gain: str | None = option(
        None,
        "Gain of the sound, such as -12dB, in place of what `normalise` would measure.",
        metavar="LEVEL",
    )
    to: str | None = option(
        None,
        "Fold the score's layout: binaural, stereo, ambix1 … ambix7, or another layout.",
        metavar="WHERE",
    )
    head: str | Path | None = option(None, "Another head for --to binaural.", metavar="FILE.sofa")
    frozen: Path | str | None = option(
        None,
        "Read these parts (from `ergon render --freeze`) instead of computing them.",
        PathTo("folder"),
        metavar="DIR",
    )
    osc: str | None = option(
        None,
        "Accept OSC requests at this port; without HOST from your programs here alone.",
        metavar="[HOST:]PORT",
    )
    osc_to: str | None = option(
        None, "Send by OSC what is played, and when it is heard.", metavar="HOST:PORT"
    )
    view: bool = option(False, "Show in a browser what moves while it plays.")
    view_at: str | None = option(
        None,
        "Show it here. Default: any free port of this machine. The address has a key.",
        metavar="HOST:PORT",
    )
    see: str | None = option(
        None, "With --view: all computes what nobody hears too.", Choice(("all",))
    )

    @property
    def card(self) -> str:
        """Where the sound goes, with the size of its blocks."""
        return self.audio if self.block is None else f"{self.audio},block={self.block}"


@documented
@dataclass(frozen=True, kw_only=True)
class PlayOptions(AccuracyOptions, PerformanceOptions):
    """How a score is played from beginning to end."""

    from_: str | None = option(
        None,
        "Where to begin, such as '3|1' (in quotes), B+2 or 12.5s.",
        metavar="POSITION",
    )
    until: str | None = option(None, "Where to stop, such as '5|1'.", metavar="POSITION")
    loop: bool = option(
        False, "Begin again at the end, until Ctrl-C; with --until again at --from."
    )
    guide: Sequence[str] = option(
        (),
        "Pull the real key along the player's written part, by a spring of K [N/m].",
        metavar="PLAYER[=K]",
    )
    standin: Sequence[str] = option(
        (),
        "Play this take or gesture where the player has no device; repeatable.",
        metavar="PLAYER=TAKE",
    )
    record: str | None = option(
        None, "Record what the hands do into a new file.", metavar="FILE.take"
    )
    record_input: str | None = option(
        None,
        "Write what inputs hear into a new file, for `ergon render --input`.",
        metavar="FILE.wav",
    )


@documented
@dataclass(frozen=True, kw_only=True)
class SessionOptions(PerformanceOptions):
    """How a session is opened."""

    journal: Path | str = option(
        Path("session.jsonl"),
        "File that keeps every line typed; where it exists, the next free name is taken.",
        PathTo("file"),
        metavar="FILE",
        shown=True,
    )
    resume: Path | str | None = option(
        None,
        "Continue the session of this journal, where it ends.",
        PathTo("file"),
        metavar="FILE",
    )
    watch: bool = option(False, "Reload the score whenever it is saved.")
    socket: str | None = option(
        None,
        "Run the engine as a process of its own at this socket, or join the one that runs there.",
        Text(if_alone=""),
        metavar="[PATH]",
    )
    trust: bool = option(False, "Allow the score to name files outside its folder.")
    midi: Sequence[str] = option(
        (),
        "Hear MIDI from the input whose name contains this, or `virtual`; repeatable.",
        metavar="PORT",
    )
    midi_clock_from: str | None = option(
        None,
        "Follow the MIDI clock of this input: its start and stop, its tempo and its beat.",
        metavar="PORT",
    )
    midi_clock_to: str | None = option(None, "Send MIDI clock to this output.", metavar="PORT")
