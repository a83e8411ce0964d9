"""Commands that make no new version: transport, stopping, undo, saving, looking."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon._core import StoppedError
from ergon.live.display import SILENT_PEAK, decibels_of
from ergon.notation.clock.positions import parse_position
from ergon.notation.text.errors import TextError
from ergon.notation.text.files import is_shipped
from ergon.repl.language.commands import NOW, Command, Now
from ergon.repl.language.hearing import Hear
from ergon.repl.language.help import overview, verb_help
from ergon.repl.language.levels import Meters
from ergon.repl.language.library import ListGestures, ListInstruments, ListScenes, Show
from ergon.repl.language.looking import Help, Look, Py, Quit, Trace, TraceOn
from ergon.repl.language.recording import Record, RecordAudio, RecordOff
from ergon.repl.language.stopping import Panic, Release
from ergon.repl.language.transport import Play, Quant, Stop, Tap, Tempo
from ergon.repl.language.versions import Back, History, KeepAsScore, Redo, Save, Undo
from ergon.repl.session import bars, computing, files, inspection, listings, version_edits
from ergon.repl.session import midi_commands as midi_commands
from ergon.repl.session.command_table import SESSION_COMMANDS as SESSION_COMMANDS
from ergon.repl.session.command_table import executes
from ergon.repl.session.entry import Entry
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.scene_edits import read_scene
from ergon.repl.session.version import NotTakenError, Version, first_line
from ergon.repl.session_protocol import Reply

if TYPE_CHECKING:
    from ergon.repl.session.core import SessionCore
    from ergon.repl.session.schedule import Schedule
    from ergon.scores.reading.piece import Piece

# A longer pause between taps begins a new count [s]: nobody taps slower than 20 bpm.
_TAP_PAUSE_MAX = 3.0
_TAP_BPM = (30.0, 300.0)  # range of tapped tempos; others are slips
_TAPS_MAX = 8  # only the latest taps count
_SHOWN_CHARACTERS_MAX = 1000  # characters of what `py` gives


@executes(Play)
def _play(session: SessionCore, command: Play) -> Reply:
    clock, tempo_map = session.schedule.running.clock, session.schedule.head.piece.tempo_map
    if command.start is None and clock.is_running:
        raise NotTakenError(
            "the piece is already running; `play from 1|1` starts it from the beginning"
        )
    if session.stops.is_stopped and session.stops.may_release:
        session.release()
    if session.stops.panicked:
        raise NotTakenError("a panic was entered after this line: type `release`, then `play`")
    play_beat = clock.stopped_beat
    if command.start is not None:
        try:
            play_beat = tempo_map.resolve(command.start)
        except TextError as error:
            raise NotTakenError(error.message) from None
    play_entry = Entry(
        "play",
        version_edits.unchanged_version,
        LineKind.START,
        NOW,
        sets_running=True,
        enter_beat=play_beat,
        restored_line_number=-1,
    )
    beat_text, _ = session.queue(play_entry)
    return Reply(True, f"ok from {beat_text}")


@executes(Hear)
def _hear(session: SessionCore, command: Hear) -> Reply:
    if session.stops.panicked:
        raise NotTakenError("a panic is active: type `release`, then `hear` again")
    return Reply(True, f"ok {session.hearing.strike(command)}")


@executes(Stop)
def _stop(session: SessionCore, command: Stop) -> Reply:
    is_starting = any(waiting_line.sets_running for waiting_line in session.schedule.waiting)
    if not (session.schedule.running.clock.is_running or is_starting):
        raise NotTakenError("the piece is already stopped; `play` continues it")
    line_time = NOW if command.when is None else command.when
    stop_entry = Entry(
        "stop",
        version_edits.unchanged_version,
        LineKind.STOPS,
        line_time,
        sets_running=False,
        restored_line_number=-1,
    )
    beat_text, _ = session.queue(stop_entry)
    return Reply(True, f"ok {beat_text} the piece stops; `play` continues from there")


@executes(Panic)
def _panic(session: SessionCore, command: Panic) -> Reply:
    session.stops.panic_in_turn()
    return Reply(True, "")


@executes(Release)
def _release(session: SessionCore, command: Release) -> Reply:
    if not session.stops.is_stopped:
        raise NotTakenError("no panic is active, and no force is off")
    if not session.stops.may_release:
        raise NotTakenError("a stop was entered after this line: type `release` again")
    session.release()
    return Reply(True, "ok")


@executes(Quant)
def _set_quant(session: SessionCore, command: Quant) -> Reply:
    session.quant = None if isinstance(command.grid, Now) else command.grid
    session.quant_text = command.words["grid"].text
    return Reply(True, f"ok lines act on: {session.quant_text}")


@executes(Tap)
def _tap(session: SessionCore, command: Tap) -> Reply:
    instant_now = time.monotonic()
    tap_instants = session.tap_instants
    if tap_instants and instant_now - tap_instants[-1] > _TAP_PAUSE_MAX:
        tap_instants.clear()
    tap_instants.append(instant_now)
    del tap_instants[:-_TAPS_MAX]
    if len(tap_instants) < 2:
        return Reply(True, "tap 1: one more sets the tempo")
    beat_length = (tap_instants[-1] - tap_instants[0]) / (len(tap_instants) - 1)
    bpm = round(60.0 / max(beat_length, 1e-3), 1)
    if not _TAP_BPM[0] <= bpm <= _TAP_BPM[1]:
        bpm_min, bpm_max = _TAP_BPM
        tap_instants.clear()
        message = f"the taps are at {bpm:g} bpm; tap between {bpm_min:g} and {bpm_max:g} bpm, or"
        return Reply(False, f"{message} write a tempo", "tempo 120")
    return session.make_version(f"tempo {bpm:g}", [Tempo(bpm, when=NOW)])


@executes(Undo)
def _undo(session: SessionCore, command: Undo) -> Reply:
    return _go_back(session, command, 1, "undo", "this is the first version")


@executes(Back)
def _back(session: SessionCore, command: Back) -> Reply:
    line = f"back {command.count}"
    return _go_back(session, command, command.count, line, "there are fewer versions than that")


def _go_back(
    session: SessionCore, command: Command, n_lines: int, line_text: str, limit_text: str
) -> Reply:
    """Go back by `n_lines` lines. Those that still wait are cancelled, and those undone before
    that wait again. If any has taken effect, or an `undo` waits that was typed after it, the
    version before all of them is restored.
    """
    history = session.history
    target_index = history.index - n_lines
    if target_index < 0:
        raise NotTakenError(f"{limit_text}; `history` lists the versions")
    reverted_numbers = history.numbers[target_index + 1 : history.index + 1]
    undone_numbers = history.undone_numbers
    reverted_lines = [
        waiting_line
        for waiting_line in session.schedule.waiting
        if waiting_line.number in reverted_numbers
    ]
    for cancelled_line in reversed(session.schedule.waiting):
        if cancelled_line.number in (*reverted_numbers, *undone_numbers):
            session.drop(cancelled_line)
            session.cancelled_lines.append(cancelled_line)
    restoring_lines = (
        waiting_line for waiting_line in session.schedule.waiting if waiting_line.restores_version
    )
    is_restored = any(
        waiting_line.number > min(reverted_numbers) for waiting_line in restoring_lines
    )
    if len(reverted_lines) == len(reverted_numbers) and not is_restored:
        quoted_lines = " and ".join(
            f"'{first_line(waiting_line.line)}'" for waiting_line in reverted_lines
        )
        cancelled_text = (
            "is cancelled before it" if len(reverted_lines) == 1 else "are cancelled before they"
        )
        return Reply(True, f"ok {quoted_lines} {cancelled_text} took effect")
    return _restore(session, command, target_index, line_text)


@executes(Redo)
def _redo(session: SessionCore, command: Redo) -> Reply:
    history, schedule = session.history, session.schedule
    if history.index + 1 < len(history.numbers):
        return _restore(session, command, history.index + 1, "redo")
    if not session.cancelled_lines:
        raise NotTakenError("no version was undone; `history` lists the versions")
    cancelled_line = session.cancelled_lines[-1]
    named_position = None
    if cancelled_line.beat >= schedule.place(NOW, None)[0]:
        named_position = parse_position(session.position_text(cancelled_line.beat))
    redo_entry = Entry(
        cancelled_line.line,
        cancelled_line.edit,
        cancelled_line.kind,
        named_position,
        reads_files=cancelled_line.reads_files,
        is_redo=True,
    )
    beat_text, _ = session.queue(redo_entry)
    session.cancelled_lines.pop()
    return Reply(True, f"ok {beat_text} {first_line(cancelled_line.line)}")


def _restore(session: SessionCore, command: Command, history_index: int, line_text: str) -> Reply:
    past_versions, number = session.schedule.past_versions, session.history.numbers[history_index]

    def restore_version(version: Version, beat: float) -> Version:
        return past_versions[number].restore(version, beat)

    beat_text, queued_version = session.queue(
        Entry(line_text, restore_version, when=command.when, restored_line_number=number)
    )
    session.history.go_to(number)
    change_texts = [
        f"as after: {first_line(past_versions[number].line) or 'the beginning'}",
        *session.log.force_messages(queued_version),
    ]
    return Reply(True, f"ok {beat_text} {'; '.join(change_texts)}")


@executes(History)
def _list_history(session: SessionCore, command: History) -> Reply:
    history_rows = []
    for history_index, number in enumerate(session.history.numbers):
        version = session.schedule.past_versions[number]
        marker = ">" if history_index == session.history.index else " "
        history_rows.append(
            f"{marker} {history_index:3}  {version.beat_text:>8}  "
            f"{first_line(version.line) or '(the score)'}"
        )
    return Reply(True, "", lines=tuple(history_rows))


@executes(Help)
def _show_help(session: SessionCore, command: Help) -> Reply:
    return Reply(True, "", lines=overview() if command.verb is None else verb_help(command.verb))


def _inspection_arguments(schedule: Schedule, name: str) -> tuple[Version, str, Piece, float]:
    """A name, with the latest version, the running piece and its present beat, for `inspection`."""
    return schedule.head, name, schedule.running.version.piece, schedule.beat_now()


@executes(Show)
def _show(session: SessionCore, command: Show) -> Reply:
    schedule = session.schedule
    if command.name is not None:
        return Reply(
            True,
            "",
            lines=tuple(
                inspection.definition_lines(*_inspection_arguments(schedule, command.name))
            ),
        )
    gestures_in_flight = schedule.running.ongoing_gestures(schedule.engine.frame)
    return Reply(
        True,
        "",
        lines=tuple(
            inspection.playing_lines(schedule.head, gestures_in_flight, schedule.beat_now())
        ),
    )


@executes(ListInstruments)
def _list_instruments(session: SessionCore, command: ListInstruments) -> Reply:
    head_version = session.schedule.head
    if command.family is None:
        return Reply(
            True, "", lines=tuple(listings.instrument_lines(head_version.texts, head_version.piece))
        )
    family_rows = listings.family_lines(head_version.texts, head_version.piece, command.family)
    return Reply(True, "", lines=tuple(family_rows))


@executes(ListGestures)
def _list_gestures(session: SessionCore, command: ListGestures) -> Reply:
    return Reply(True, "", lines=tuple(listings.gesture_lines(session.schedule.head.piece)))


@executes(ListScenes)
def _list_scenes(session: SessionCore, command: ListScenes) -> Reply:
    with session.computing.limited(computing.FILES_STEPS):
        return Reply(True, "", lines=tuple(listings.scene_lines(session.schedule.head.texts)))


@executes(Look)
def _look(session: SessionCore, command: Look) -> Reply:
    schedule = session.schedule
    if command.name is None:
        gestures_in_flight = schedule.running.ongoing_gestures(schedule.engine.frame)
        return Reply(
            True,
            "",
            lines=tuple(
                bars.draw_bars(schedule.head.piece, gestures_in_flight, schedule.beat_now())
            ),
        )
    with session.computing.limited(computing.LINE_STEPS):
        return Reply(
            True,
            "",
            lines=tuple(inspection.draw_name(*_inspection_arguments(schedule, command.name))),
        )


@executes(Trace)
def _draw_trace(session: SessionCore, command: Trace) -> Reply:
    with session.computing.limited(computing.LINE_STEPS):
        trace_lines = inspection.draw_trace(
            session.schedule.running,
            session.schedule.engine.frame,
            command.name,
            session.schedule.engine.tick_frames,
            session.captures.hands_recording,
        )
    return Reply(True, "", lines=tuple(trace_lines))


@executes(TraceOn)
def _switch_trace(session: SessionCore, command: TraceOn) -> Reply:
    if command.name is not None:
        _draw_trace(session, Trace(command.name))  # refuses what cannot be drawn
    session.traced_player = command.name
    session.draw_trace()
    return Reply(True, "ok")


@executes(Meters)
def _show_meters(session: SessionCore, command: Meters) -> Reply:
    peaks = session.schedule.engine.status().peaks
    channel_rows = [
        f"{channel:3}  {decibels_of(peak):6.1f} dB"
        if peak > SILENT_PEAK
        else f"{channel:3}  silent"
        for channel, peak in enumerate(peaks, 1)
    ]
    return Reply(True, "", lines=tuple(channel_rows or ["no channel is metered here"]))


@executes(Save)
def _save(session: SessionCore, command: Save) -> Reply:
    written_files = files.save_version(
        session, None if command.file is None else Path(command.file)
    )
    if not written_files:
        return Reply(True, "ok nothing to write: the files already hold this version")
    return Reply(True, f"ok wrote {', '.join(written_files)}")


@executes(Record)
def _record(session: SessionCore, command: Record) -> Reply:
    if (
        session.captures.hands_recording is None
        or command.player not in session.schedule.real_hands
    ):
        raise NotTakenError(
            f"no real hand plays {command.player}: start ergon with --live {command.player}=DEVICE"
        )
    if is_shipped(Path(session.schedule.head.texts.path)):
        raise NotTakenError(
            "a take is written beside its score, and this score ships with ergon: "
            "`save NAME`, then `load NAME.yaml`"
        )
    record_beat, _ = session.schedule.place(session.resolved_time(command.when), session.quant)
    session.captures.begin(command.player, command.take, session.schedule.frame_of(record_beat))
    return Reply(
        True,
        f"ok {session.position_text(record_beat)} recording {command.player}; `record off` ends "
        "the take",
    )


@executes(RecordOff)
def _record_off(session: SessionCore, command: RecordOff) -> Reply:
    beat, _ = session.schedule.place(session.resolved_time(command.when), session.quant)
    capture = session.captures.end(session.schedule.frame_of(beat))
    return Reply(True, f"ok {session.position_text(beat)} take {capture.name} ends")


@executes(RecordAudio)
def _record_audio(session: SessionCore, command: RecordAudio) -> Reply:
    engine = session.schedule.engine
    if command.file is None:
        return Reply(True, f"ok {session.sound_file.end(engine)} ends")
    path = files.new_file_beside(session.schedule.head.texts, Path(command.file), ".wav")
    session.sound_file.begin(engine, path)
    return Reply(True, f"ok recording what is heard in {path}; `record audio off` ends it")


@executes(KeepAsScore)
def _keep(session: SessionCore, command: KeepAsScore) -> Reply:
    written_files = files.write_last_bars(session, command.length, command.name)
    read_scene(
        session.schedule.head.texts, command.name
    )  # read it now, so that `scene` answers at once
    return Reply(True, f"ok wrote {', '.join(written_files)}")


@executes(Py)
def _evaluate_python(session: SessionCore, command: Py) -> Reply:
    """Evaluate an expression of the user; an error in it is reported as theirs."""
    python_names: dict[str, Any] = {
        "session": session,
        "piece": session.schedule.head.piece,
        "math": math,
        "__builtins__": __builtins__,
    }
    try:
        value = eval(command.expression, python_names)
        return Reply(True, "" if value is None else repr(value)[:_SHOWN_CHARACTERS_MAX])
    except StoppedError:
        raise
    except BaseException as error:  # also `exit()`
        error_text = f"{type(error).__name__}: {error}".rstrip(": ")
        raise NotTakenError(f"your Python raised {error_text[:_SHOWN_CHARACTERS_MAX]}") from None


@executes(Quit)
def _quit(session: SessionCore, command: Quit) -> Reply:
    return Reply(True, "bye", leaves=True)
