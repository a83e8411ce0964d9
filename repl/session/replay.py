"""Replays a journal: the same versions at the same frames.

It serves `render`, and sessions that are resumed (`--resume`).
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING

from ergon.exchange.frozen import NotFrozenError
from ergon.repl.language.hearing import Hear
from ergon.repl.session import version_edits
from ergon.repl.session.clock import Clock, Timing, takeover_beats
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.frozen_parts import LoadedPart, load_frozen
from ergon.repl.session.gains import fader_ratios
from ergon.repl.session.history import PastVersions
from ergon.repl.session.journal import JournalError, JournalEvent
from ergon.repl.session.journal_content import (
    FileVersion,
    JournalAct,
    JournalCommit,
    JournalContent,
)
from ergon.repl.session.journal_hands import RecordedHands, recorded_hands
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.past_versions import PastVersionStore
from ergon.repl.session.replayed_schedule import ReplayedSchedule
from ergon.repl.session.running import RunningVersion, stage_first
from ergon.repl.session.struck_places import place_number
from ergon.repl.session.version import NotTakenError, PastVersion, Version, piece_of
from ergon.repl.session.waiting_lines import REFUSALS, VersionEdit, WaitingLine, reparse
from ergon.scores.staging.drives import input_id
from ergon.scores.staging.preparing import DURATION_MAX

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Errors that a forged journal can cause while it is replayed.
_FORGERY_ERRORS = (
    ArithmeticError,
    AssertionError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
_KIND_BY_NAME = {kind.name.lower(): kind for kind in LineKind}
_BLOCK_FRAMES = 4096  # frames between two checks for due lines


@contextlib.contextmanager
def _as_journal_errors(journal_event: JournalEvent) -> Iterator[None]:
    """Turn errors of this block into a JournalError with the place of the event."""
    try:
        yield
    except (*REFUSALS, *_FORGERY_ERRORS) as error:
        failed_text = (
            ascii(journal_event.get("line", str)[:80])
            if journal_event.name == "line"
            else "its score"
        )
        journal_event.refuse(f"{failed_text} cannot be replayed: {error}")


class ReplayedSession:
    """A session that is computed from its journal, with the interface of a stage for
    `rendering.render`.

    Its simulation gives mixed frames, and its mixer passes them through.
    """

    def __init__(self, journal_content: JournalContent) -> None:
        """Begin at frame 0. Raises JournalError, NotTakenError, StageError."""
        session_start, take = journal_content.session_start, journal_content.session_start.take
        with _as_journal_errors(journal_content.first_event):
            version = session_start.version()
        real_players = {} if take is None else dict.fromkeys(hand.player for hand in take.hands)
        for hand in () if take is None else take.hands:
            player = version.piece.players.get(hand.player)
            if player is None or player.key != hand.key:
                journal_content.first_event.refuse(f"its score has no {hand.player} on {hand.key}")
        frozen_parts = _load_frozen_parts(journal_content, version, real_players)
        running = stage_first(
            version,
            Clock(None, session_start.beat),
            real_players,
            None,
            frozen_parts,
            is_seen=session_start.is_seen,
        )
        hand_movements = RecordedHands((), 0, ())
        if take is not None:
            hand_movements = recorded_hands(take, running.stage, session_start.tick_frames)
        self._engine = SteppedEngine(
            running.stage,
            tick_frames=session_start.tick_frames,
            highpass=session_start.highpass,
            reference=session_start.reference,
            hands=hand_movements.hands,
        )
        self._engine.set_faders(fader_ratios(running))
        self._schedule = ReplayedSchedule(self._engine, running, real_players, 0)
        self._versions = _initial_versions(journal_content, version)
        self._due_changes = deque(_journal_changes(journal_content))
        self._note_next_change()
        self._due_acts = deque(journal_content.acts)
        self._file_versions = journal_content.versions_from_files
        self._last_event = journal_content.first_event
        self._file = journal_content.first_event.file
        self.rate = running.stage.rate
        # A session that was killed may have recorded hands after its last line.
        self.n_frames = journal_content.n_frames
        if not journal_content.has_ended:
            self.n_frames = max(self.n_frames, hand_movements.n_frames)
        self.warnings = (
            *hand_movements.warnings,
            *_gap_warnings(journal_content, hand_movements, self.rate),
        )
        if journal_content.n_frames > DURATION_MAX * self.rate:
            raise NotTakenError("the journal claims that the session lasted longer than a day")
        self.n_channels = self.n_out = running.stage.n_channels

    @property
    def simulation(self) -> ReplayedSession:
        """The source of frames: this object itself."""
        return self

    @property
    def running(self) -> RunningVersion:
        """The running version, staged."""
        return self._schedule.running

    def mixer(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> _PassThroughMixer:
        """A mixer that changes nothing: the frames are mixed already."""
        return _PassThroughMixer()

    def stems(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        is_split: bool = False,
    ) -> list[tuple[str, _PassThroughMixer]]:
        """No stems: a session is rendered as one sound."""
        return []

    def measured_stems(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> list[tuple[str, _PassThroughMixer, float]]:
        """No instruments: a session is measured as one sound."""
        return []

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_channels) with the next frames."""
        n_done_frames = 0
        while n_done_frames < len(out):
            self._do_due_items()
            n_block_frames = min(
                _BLOCK_FRAMES, len(out) - n_done_frames, *self._frames_until_due(len(out))
            )
            out[n_done_frames : n_done_frames + n_block_frames] = self._engine.process(
                n_block_frames
            )
            n_done_frames += n_block_frames

    def _frames_until_due(self, frames_max: int) -> Iterator[int]:
        """Numbers of frames until the next change or act, and `frames_max`."""
        for due_items in (self._due_changes, self._due_acts):
            if due_items:
                yield max(1, due_items[0].frame - self._engine.frame)
        yield frames_max

    def _note_next_change(self) -> None:
        """Note the next change. The timeline ends where that of the session ended at a skip."""
        schedule, coming_changes = self._schedule, self._due_changes
        schedule.next_frame = coming_changes[0].frame if coming_changes else math.inf
        staged_change = next((change for change in coming_changes if change.is_staged), None)
        schedule.version_maker.latest_beat = math.inf
        if staged_change is not None and staged_change.skipped_from is not None:
            schedule.version_maker.latest_beat = staged_change.skipped_from

    def _do_due_items(self) -> None:
        """Hand the engine the changes and acts that take effect at this frame."""
        schedule = self._schedule
        schedule.take_events()
        while self._due_changes and self._due_changes[0].frame <= self._engine.frame:
            due_change = self._due_changes.popleft()
            self._note_next_change()
            if not due_change.commits:
                with _as_journal_errors(self._last_event):
                    schedule.skip(due_change.frame)
                continue
            lines = [self._line_of_commit(commit) for commit in due_change.commits]
            with _as_journal_errors(due_change.commits[0].line):
                schedule.perform_lines(lines, self._versions)
            self._last_event = due_change.commits[-1].line
        with _as_journal_errors(self._last_event):
            schedule.extend()
        while self._due_acts and self._due_acts[0].frame <= self._engine.frame:
            self._do_act(self._due_acts.popleft())

    def _line_of_commit(self, commit: JournalCommit) -> WaitingLine:
        """A line at the frame at which it took effect."""
        line_event, sets_running = commit.line, commit.line.fields.get("goes")

        def edit(version: Version, beat: float) -> Version:
            return line_edit(line_event, self._versions, version, self._file_versions)(
                version, beat
            )

        return WaitingLine(
            line_event.get("number", int),
            line_event.get("line", str),
            edit,
            _line_kind(line_event),
            commit.beat,
            commit.frame,
            sets_running if isinstance(sets_running, bool) else None,
            bool(line_event.fields.get("resets")),
            is_now=True,
        )

    def _do_act(self, act: JournalAct) -> None:
        if isinstance(act.target, str):
            self._engine.set_input(input_id(act.target), act.amount)
            missing_text = "at this value has no such input"
        else:
            self._engine.strike(place_number(act.target), act.amount)
            missing_text = "at this strike has no such mass"
        events = self._schedule.take_events()
        if any(event.act_ticket is not None and event.is_late for event in events):
            JournalEvent(self._file, act.line, "", {}).refuse(
                f"the piece that plays {missing_text}; the journal does not match its score"
            )


@dataclass(frozen=True, slots=True)
class _ReplayedChange:
    """Lines that took effect together at a frame; without lines, the end of a skip.

    `skipped_from` is the beat from which on nothing had begun before it.
    """

    frame: int
    commits: Sequence[JournalCommit] = ()
    skipped_from: float | None = None

    @property
    def is_staged(self) -> bool:
        """Whether a new stage plays from there on, with a timeline of its own."""
        return any(_line_kind(commit.line) is not LineKind.FADERS for commit in self.commits) or (
            self.skipped_from is not None
        )


def _journal_changes(journal_content: JournalContent) -> Iterator[_ReplayedChange]:
    """The changes of a journal, in the order of their frames."""
    beat_by_skip_frame = dict(journal_content.skips)
    for (commit_frame, _), commits in groupby(
        journal_content.commits, lambda commit: (commit.frame, commit.change)
    ):
        for skip_frame in [
            skip_frame for skip_frame in beat_by_skip_frame if skip_frame < commit_frame
        ]:
            yield _ReplayedChange(skip_frame, (), beat_by_skip_frame.pop(skip_frame))
        yield _ReplayedChange(
            commit_frame, tuple(commits), beat_by_skip_frame.pop(commit_frame, None)
        )
    for skip_frame, begin_beat in beat_by_skip_frame.items():
        yield _ReplayedChange(skip_frame, (), begin_beat)


def _line_kind(event: JournalEvent) -> LineKind:
    """The kind of a line; a journal without kinds staged every line."""
    name = event.fields.get("kind")
    return (
        _KIND_BY_NAME.get(name, LineKind.STRUCTURE) if isinstance(name, str) else LineKind.STRUCTURE
    )


def _load_frozen_parts(
    journal_content: JournalContent, version: Version, real_players: Collection[str]
) -> tuple[LoadedPart, ...]:
    """The frozen parts with which a session began. Raises JournalError."""
    folder = journal_content.session_start.frozen
    if folder is None:
        return ()
    try:
        return load_frozen(folder, version, real_players)
    except NotFrozenError as error:
        part_names = ", ".join(part.name for part in folder.parts)
        raise JournalError(
            f"{error}; the session plays {part_names} from there, and cannot be computed without"
        ) from None


def _initial_versions(journal_content: JournalContent, version: Version) -> PastVersionStore:
    """The versions that exist when a session begins."""
    history, versions = journal_content.session_start.history, PastVersionStore()
    versions[0] = PastVersion.from_version(version, "1|1")
    for past_version in () if history is None else history.versions:
        versions[past_version.number] = past_version
    return versions


def resumed_state(journal_content: JournalContent) -> tuple[Version, Clock, PastVersions]:
    """The last version, a clock stopped at the last bar, and the history; no sound is computed.

    Raises JournalError, NotTakenError.
    """
    session_start = journal_content.session_start
    with _as_journal_errors(journal_content.first_event):
        version = session_start.version()
    versions = _initial_versions(journal_content, version)
    clock = Clock(None, session_start.beat)
    rate = version.piece.rate
    timing = Timing(rate, session_start.tick_frames)
    committed_numbers = {commit.line.get("number", int) for commit in journal_content.commits}
    waiting_lines = [
        (
            journal_content.n_frames,
            journal_content.late_beats.get(
                number, journal_content.lines[number].get("beat", float)
            ),
            event,
        )
        for number, event in (
            (line_number, journal_content.lines[line_number])
            for line_number in journal_content.effect_order()
        )
        if number not in committed_numbers and number not in journal_content.dropped_numbers
    ]
    committed_lines = [
        (commit.frame, commit.beat, commit.line) for commit in journal_content.commits
    ]
    for takeover_frame, line_beat, line_event in (*committed_lines, *waiting_lines):
        with _as_journal_errors(line_event):
            makes_running = line_event.fields.get("goes")
            is_running = makes_running if isinstance(makes_running, bool) else version.is_running
            old_tempo_map = version.piece.tempo_map
            version = replace(version.taken_over(), is_running=is_running)
            version = line_edit(line_event, versions, version, journal_content.versions_from_files)(
                version, line_beat
            )
            tempo_map = version.piece.tempo_map
            versions[line_event.get("number", int)] = PastVersion.from_version(
                version, tempo_map.written(line_beat), line_event.get("line", str)
            )
            sets_running = makes_running if isinstance(makes_running, bool) else None
            takeover = takeover_beats(
                clock,
                old_tempo_map,
                tempo_map,
                line_beat,
                takeover_frame,
                sets_running,
                version.takeover_beat,
                timing,
            )
            clock = takeover.clock
    tempo_map = version.piece.tempo_map
    last_beat = clock.beat(tempo_map, journal_content.n_frames / rate)
    if not (math.isfinite(last_beat) and journal_content.n_frames <= DURATION_MAX * rate):
        raise NotTakenError("the journal claims that the session lasted longer than a day")
    bar, _ = tempo_map.bar_beat(last_beat)
    # Guidance is not resumed: a hand is pulled only after a line that asks for it.
    resumed_version = replace(
        version.taken_over(),
        number=0,
        line="",
        guides={},
        file_texts=journal_content.file_texts,
        is_running=False,
    )
    return (
        resumed_version,
        Clock(None, tempo_map.bars.start(bar)),
        _renumbered_history(journal_content, resumed_version, versions),
    )


def _renumbered_history(
    journal_content: JournalContent, resumed_version: Version, versions: Mapping[int, PastVersion]
) -> PastVersions:
    """The history of the session resumed as `resumed_version`, numbered for its own journal."""
    history = journal_content.history()
    past_versions = []
    for index, old_number in enumerate(history.numbers):
        # Numbers from 1 on belong to the lines of that session, and -1 means none.
        new_number = 0 if index == history.index else -2 - index
        known_version = versions.get(old_number) or PastVersion.from_version(resumed_version)
        if new_number == 0:
            known_version = PastVersion.from_version(
                resumed_version, known_version.beat_text, known_version.line
            )
        past_versions.append(replace(known_version, number=new_number, guides={}))
    return PastVersions(past_versions, history.index)


def line_edit(
    line_event: JournalEvent,
    versions: Mapping[int, PastVersion],
    old_version: Version,
    file_versions: Mapping[int, FileVersion],
) -> VersionEdit:
    """The version edit of a journal's line, without its other effects. Raises NotTakenError."""
    if line_event.fields.get("resets"):
        return version_edits.end_all_playing
    if (file_version := file_versions.get(line_event.number)) is not None:
        texts, glide, enter_beat = file_version
        return lambda version, beat: replace(
            version,
            texts=texts,
            piece=piece_of(texts),
            glide_duration=glide,
            takeover_beat=enter_beat,
        )
    restored_number = line_event.fields.get("restores")
    if isinstance(restored_number, int):
        restored_version = versions.get(restored_number)
        return (
            version_edits.unchanged_version
            if restored_version is None
            else restored_version.restore
        )
    commands = reparse(line_event.get("line", str), old_version)
    if any(
        type(command) in version_edits.READS_FILES for command in commands
    ):  # rendering a journal reads no further file
        raise NotTakenError("the journal lacks the texts that this line read from files")
    edit_commands = [
        command for command in commands if type(command) in version_edits.VERSION_EDITS
    ]
    # What `hear` needs is a line of its own, also where it was typed together with others.
    music_commands = [command for command in edit_commands if not isinstance(command, Hear)]
    return version_edits.combine_edits(music_commands or edit_commands)


def _gap_warnings(
    journal_content: JournalContent, hand_movements: RecordedHands, rate: float
) -> Iterator[str]:
    """Warnings about gaps in a journal, a missing end, and a recording that ends early."""
    if gap_sentence := journal_content.gaps.sentence(journal_content.first_event.file):
        yield gap_sentence
    duration = journal_content.n_frames / rate
    if not journal_content.has_ended:
        yield (
            f"{journal_content.first_event.file} has no end: the session was killed, is still "
            f"playing, or could not write; its last event is at {duration:.1f} s"
        )
    if hand_movements.hands and hand_movements.n_frames < journal_content.n_frames:
        yield (
            f"the recording of hands ends at {hand_movements.n_frames / rate:.1f} s of "
            f"{duration:.1f} s; "
            "from there they stay where they were"
        )


class _PassThroughMixer:
    """A mixer that passes frames through."""

    def process(self, frames: NDArray[np.float64], mixed_frames: NDArray[np.float64]) -> None:
        """Copy (n_frames, n_channels)."""
        mixed_frames[:] = frames

    def state(self) -> bytes | None:
        """Nothing that is worth storing."""

    def set_state(self, state: bytes) -> None:
        """Nothing depends on frames before."""
