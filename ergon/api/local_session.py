"""A session: a score that is played while lines change it, in this process."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.rendering.level import HIGHPASS_HZ

from . import freeze
from . import score as scores
from .errors import OptionError, not_started_error
from .fold import fold_of
from .gain import performance_gain
from .hands import boards_of, calibrated_boards, driven_players, open_hands
from .midi import attach_midi, midi_ports
from .options import ReadOptions, SessionOptions
from .osc import osc_of
from .pages import pages_of, sees_all

if TYPE_CHECKING:
    from ergon.live.boards import Board
    from ergon.live.osc import OscServer
    from ergon.live.perform import PlaybackConfig
    from ergon.live.pointer_hands import PointerHands
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.disk import Disk
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.frozen_parts import FrozenFolder, LoadedPart
    from ergon.repl.session.history import PastVersions
    from ergon.repl.session.journal_content import SessionStart
    from ergon.repl.session.session import Session
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

    from .midi import MidiPorts

# Time that a change needs from the session to the physics thread, on a busy machine too [s].
_CHANGE_LEAD_SECONDS = 0.006
_THREAD_SWITCH_SECONDS = 0.0005  # [s]
_GainAndReference = tuple[float, float | None]  # gain, and reference level: ratios


_EMPTY_PIECE = "ergon: 1\nmix: {channels: 2}\n"


def begin_session(path: str | None, options: SessionOptions, report: Report) -> Session:
    """Open a session on the sound card; the caller closes it.

    Raises ScoreError, OptionError and DeviceError.
    """
    from ergon.exchange.plan_store import user_store
    from ergon.repl.session.journal import Journal, JournalError, free_path
    from ergon.repl.session.session import Session

    is_seen = sees_all(options)
    beginning = _session_beginning(path, options, report)
    version, piece = beginning.version, beginning.version.piece
    boards = boards_of(piece, options)
    driven_names = driven_players(piece, options, boards)
    real_hands = {player: None for board in boards for _, player in board.axes}
    folder, frozen = _frozen_and_folder(version, beginning.frozen, real_hands, options, report)
    boards = calibrated_boards(boards, options.unchecked, report)
    with scores.staging(version.texts.load, report):
        config = _performance_config(piece, options, boards, beginning.levels, frozen, report)
    ports = midi_ports(options, report)
    osc = osc_of(options.osc, options.osc_to, report)
    pointer_hands = open_hands(piece, boards, report)
    try:
        pages = pages_of(options, report, pointer_hands.page_pointers)
        journal = Journal.begin(Path(options.journal))
    except JournalError as error:
        pointer_hands.close()
        raise OptionError("journal", str(error)) from None
    except OptionError:
        pointer_hands.close()
        raise
    try:
        take_path = free_path(journal.path.with_suffix(".take")) if real_hands else None
        config = replace(
            config,
            record=take_path,
            header={"journal": journal.path.name},
            pages=pages,
            boards=pointer_hands.boards,
            driven_players=driven_names,
        )
        make_engine, make_session_start = _session_makers(
            version,
            beginning.clock,
            beginning.past,
            config,
            folder,
            report,
            is_seen=is_seen,
        )
        with scores.staging(version.texts.load, report):
            session = Session(
                version,
                make_engine,
                margin=_CHANGE_LEAD_SECONDS,
                journal=journal,
                real=real_hands,
                store=user_store(),
                clock=beginning.clock,
                hands=take_path,
                disk=beginning.disk,
                watches=options.watch,
                past=beginning.past,
                frozen=frozen,
                is_seen=is_seen,
                driven_players=driven_names,
            )
    except BaseException:
        journal.close()
        journal.path.unlink(missing_ok=True)  # nothing has begun
        pointer_hands.close()
        raise
    opening_fields = make_session_start(session.schedule.engine.tick_frames, take_path).fields()
    journal.append("session", **opening_fields, disk=session.disk.hashes_by_name(version.texts))
    session.attach(_SummarisedHands(pointer_hands, report))
    _attach_midi_and_osc(session, ports, osc)
    _start_session(session)
    return session


def _attach_midi_and_osc(session: Session, ports: MidiPorts, osc: OscServer | None) -> None:
    """Connect the ports and the server to a session on the sound card, until it ends."""
    from ergon.repl.session.live import LiveEngine
    from ergon.repl.session.osc import SessionOsc

    engine = session.schedule.engine
    assert isinstance(engine, LiveEngine)
    attach_midi(session, engine.performance, ports)
    if osc is not None:
        session.attach(SessionOsc(session, osc, engine.performance))


def _start_session(session: Session) -> None:
    """Start a session that is ready, and set the process up for it."""
    from ergon import _core
    from ergon.repl.prompt.signals import signals_blocked_in_threads

    # What exists now stays while the session plays: the garbage collector need not search it.
    gc.collect()
    gc.freeze()
    # A running line lets other threads in this soon, such as the one that stops a hand.
    sys.setswitchinterval(_THREAD_SWITCH_SECONDS)
    # In a notebook Ctrl-C ends a call, not the session; hands are let go until `release`.
    _core.stop_on_signals([signal.SIGINT], ends=False)
    with signals_blocked_in_threads():
        session.run()


@dataclass(frozen=True, slots=True)
class _SummarisedHands:
    """Led hands that report a summary of their input when they are closed."""

    pointer_hands: PointerHands
    report: Report

    def close(self) -> None:
        """Stop leading the hands, and report a summary for each."""
        self.pointer_hands.close()
        for sentence in self.pointer_hands.summaries():
            self.report.say(sentence)


@dataclass(frozen=True, slots=True)
class _SessionBeginning:
    """The beginning of a session: its first version, and where the piece stands.

    A resumed session also has the versions before, the gain and the reference level at which it
    was heard, the files as they were, and its frozen parts.
    """

    version: Version
    clock: Clock
    past: PastVersions | None = None
    levels: _GainAndReference | None = None
    disk: Disk | None = None
    frozen: FrozenFolder | None = None


def _session_beginning(
    path: str | None, session_options: SessionOptions, report: Report
) -> _SessionBeginning:
    """The beginning of a session of a score, or of the journal that it resumes."""
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.journal import JournalError
    from ergon.repl.session.journal_content import read_journal
    from ergon.repl.session.replay import resumed_state
    from ergon.repl.session.version import NotTakenError, Version
    from ergon.scores.edits.texts import Texts

    if session_options.resume is not None:
        resume_path = Path(session_options.resume)
        if session_options.frozen is not None:
            raise OptionError(
                "frozen", "the journal of --resume names its frozen parts; leave this option out"
            )
        try:
            journal_content = read_journal(
                resume_path, path, resumes=True, trust=session_options.trust
            )
            if gap_sentence := journal_content.gaps.sentence(str(resume_path)):
                report.warn(gap_sentence)
            session_start = journal_content.session_start
            gain_and_reference = session_start.gain, session_start.reference
            return _SessionBeginning(
                *resumed_state(journal_content),
                gain_and_reference,
                journal_content.disk,
                session_start.frozen,
            )
        except JournalError as error:
            raise OptionError("resume", str(error)) from None
        except NotTakenError as error:
            raise OptionError("resume", f"{resume_path}: {error}") from None
    if path is None:
        return _empty_piece()
    loaded = scores.read(
        path, ReadOptions(trust=session_options.trust), report, leave_out=("N401",)
    )
    piece = scores.piece_of(loaded)
    texts = Texts.read(path, scores.bounds(path, session_options.trust))
    return _SessionBeginning(Version(0, "", texts, piece), Clock())


def _empty_piece() -> _SessionBeginning:
    """The beginning of a piece that is typed from nothing; `save` writes it."""
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.disk import Disk
    from ergon.repl.session.journal import free_path
    from ergon.repl.session.version import Version
    from ergon.scores.edits.texts import Texts

    texts = Texts(str(free_path(Path("piece.yaml"))), _EMPTY_PIECE)
    piece = scores.piece_of(texts.load())
    return _SessionBeginning(Version(0, "", texts.complete(), piece), Clock(), disk=Disk())


def _frozen_and_folder(
    version: Version,
    folder: FrozenFolder | None,
    real_players: Collection[str],
    session_options: SessionOptions,
    report: Report,
) -> tuple[FrozenFolder | None, tuple[LoadedPart, ...]]:
    """The folder of frozen parts (of the resumed session, or the one asked for), and the parts that
    the version plays from it. Raises OptionError.
    """
    from ergon.exchange.frozen import NotFrozenError
    from ergon.repl.session.frozen_parts import frozen_folder, load_frozen
    from ergon.scores.staging.built_network import build_network

    piece, option_name = version.piece, "frozen" if folder is None else "resume"
    if folder is None and session_options.frozen is None:
        return None, ()
    try:
        if folder is None:
            path = Path(session_options.frozen or "")
            frozen = freeze.read(piece, path, None, report)
            freeze.check_freezable(piece, frozen, real_players)
            listening = build_network(piece, frozenset(frozen.parts)).listening
            folder = frozen_folder(path, frozen, piece, listening)
        loaded_parts = load_frozen(folder, version, real_players)
    except NotFrozenError as error:
        raise OptionError(option_name, str(error)) from None
    part_names = [part.name for part in loaded_parts]
    if part_names:
        end_position = scores.where(piece, min(part.n_frames for part in loaded_parts) / piece.rate)
        report.say(
            f"from {folder.folder}: {', '.join(part_names)}, up to {end_position} of the score"
        )
    surplus_parts = [part.name for part in folder.parts if part.name not in part_names]
    if surplus_parts:
        report.say(
            f"computed live, because the session has changed them: {', '.join(surplus_parts)}"
        )
    return folder.relative_to(Path(session_options.journal)), loaded_parts


def _performance_config(
    piece: Piece,
    session_options: SessionOptions,
    boards: Sequence[Board],
    gain_and_reference: _GainAndReference | None,
    frozen: Sequence[LoadedPart],
    report: Report,
) -> PlaybackConfig:
    from ergon.live.perform import PlaybackConfig

    master = piece.mix.master
    scores.integer_rate(piece.rate)
    sound_card = session_options.card
    if sound_card.startswith("file:"):  # typed lines need a session in real time
        sound_card = sound_card.replace("file:", "clock:", 1)
    gain, reference = gain_and_reference or (None, piece.mix.reference())
    if gain is None or session_options.gain is not None:
        gain = performance_gain(
            piece, partial(_preflight_stage, piece, frozen), session_options.gain, report
        )
    return PlaybackConfig(
        audio=sound_card,
        gain=gain,
        limit=master.limit if master is not None and master.limit is not None else 1.0,
        highpass=HIGHPASS_HZ,
        reference=reference,
        boards=boards,
        force_max=session_options.force_max,
        frames_ahead=session_options.ahead,
        audio_in=session_options.audio_in,
        fold=fold_of(piece, session_options, report),
    )


def _preflight_stage(piece: Piece, frozen: Sequence[LoadedPart]) -> Stage:
    """The stage of a preflight: the piece from its beginning, or a rehearsal if nothing plays in
    it.
    """
    from ergon.exchange.plan_store import user_store
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.frozen_parts import place_samples
    from ergon.repl.session.running import rehearsal_piece
    from ergon.scores.staging.stage import stage

    if not (piece.parts or piece.strikes):
        piece, frozen = rehearsal_piece(piece), ()
    frozen_names = frozenset(part.name for part in frozen)
    preflight_stage = stage(
        piece, planned=True, store=user_store(), silent=frozen_names, on_fault="mute"
    )
    preflight_stage.recalled_outputs = place_samples(
        frozen, preflight_stage.listening, Clock(0.0), preflight_stage.rate
    )
    return preflight_stage


def _session_makers(
    version: Version,
    clock: Clock,
    past: PastVersions | None,
    config: PlaybackConfig,
    folder: FrozenFolder | None,
    report: Report,
    *,
    is_seen: bool,
) -> tuple[Callable[[Stage], Engine], Callable[[int, Path | None], SessionStart]]:
    from ergon import _core
    from ergon.repl.prompt.signals import signals_blocked_in_threads
    from ergon.repl.session.journal_content import SessionStart
    from ergon.repl.session.journal_hands import JournalHand, JournalTake
    from ergon.repl.session.live import LiveEngine

    def make_engine(stage: Stage) -> Engine:
        try:
            with signals_blocked_in_threads():  # threads of the physics must not get these signals
                engine = LiveEngine(stage, config)
        except _core.EngineError as error:
            raise not_started_error(error, str(error)) from None
        report.say(engine.performance.output())
        if sentence := engine.performance.sound_input().sentence:
            report.say(f"input: {sentence}")
        return engine

    def start_record(tick_frames: int, hands_recording: Path | None) -> SessionStart:
        gain_options = config.gain, config.limit, config.highpass
        journal_take = None
        if hands_recording is not None:
            players = version.piece.players
            journal_hands = [
                JournalHand(player, players[player].key, board.url, axis)
                for board in config.boards
                for axis, player in board.axes
            ]
            journal_take = JournalTake(hands_recording, tuple(journal_hands))
        return SessionStart(
            version.texts,
            clock.stopped_beat,
            version.faders,
            tick_frames,
            *gain_options,
            past,
            version.file_texts,
            journal_take,
            version.maps,
            version.rules,
            config.reference,
            version.sounds_as,
            folder,
            is_seen,
            version.strike_levels,
        )

    return make_engine, start_record
