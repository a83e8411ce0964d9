"""MIDI clock by the system's clock: how evenly a session sends it, and how closely a follower keeps
to it.

Two sessions in one process play to a null output, by a clock. The first sends its clock through
the sending process, and the second follows what was sent. Meanwhile the first gets a line every
second.
"""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from benches.measure import Row
from benches.soak import _SCORE
from ergon.api.midi import MidiPorts, attach_midi
from ergon.live.midi_ports import ProcessPort
from ergon.live.midi_sender import ECHO, TimedSender
from ergon.live.osc_out import HearingClock
from ergon.live.perform import PlaybackConfig
from ergon.live.trouble import gap_count
from ergon.repl.session.live import LiveEngine
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts

_SETTLES = 10.0  # [s] until a follower has caught up


def _session(folder: Path, name: str) -> tuple[Session, LiveEngine]:
    path = folder / f"{name}.yaml"
    path.write_text(_SCORE.replace("bpm: 60", "bpm: 120"), encoding="utf-8")
    texts = Texts.read(path)
    engines: list[LiveEngine] = []

    def make(stage):
        engines.append(LiveEngine(stage, PlaybackConfig(audio="null", gain=1.0)))
        return engines[0]

    session = Session(Version(0, "", texts, piece_of(texts)), make, margin=0.006)
    session.run()
    return session, engines[0]


def _beat_instants(session: Session, ear: HearingClock, beats: np.ndarray) -> np.ndarray:
    """The instants at which beats are heard [s]."""
    running = session.schedule.running
    tempo = running.version.piece.tempo_map
    rate = session.schedule.rate
    seconds = [running.clock.seconds(tempo, float(beat)) for beat in beats]
    return np.array([ear.instant_of(int(second * rate + 0.5)) for second in seconds])


def _pass_on(sender: TimedSender, wire: ProcessPort, sent: list[tuple[float, bytes]]) -> None:
    """Pass what was sent to the follower, with the instants of sending."""
    while line := sender.next_echo():
        position, data = line.split()
        message = bytes.fromhex(data.decode())
        if message == b"\xf8":
            sent.append((int(position) / 1e9, message))
        wire.deliver(message, int(position) / 1e9)


def midi_clock(minutes: float = 1.0) -> list[Row]:
    """Lateness of clocks, and the distance of a follower's beats from those of its master."""
    with tempfile.TemporaryDirectory() as folder:
        output, telling = _session(Path(folder), "master")
        player_session, following = _session(Path(folder), "follower")
        wire, sender = ProcessPort(), TimedSender(ECHO)
        sent: list[tuple[float, bytes]] = []
        attach_midi(player_session, following.performance, MidiPorts((), wire, None))
        attach_midi(output, telling.performance, MidiPorts((), None, sender))
        threading.Thread(target=_pass_on, args=(sender, wire, sent), daemon=True).start()
        ears = [
            HearingClock(output.schedule.rate, 0),
            HearingClock(player_session.schedule.rate, 0),
        ]
        try:
            output.submit("play")
            ends = time.monotonic() + 60.0 * minutes + _SETTLES
            late: list[float] = []
            apart: list[float] = []
            done, due = 0, time.monotonic() + 1.0
            while time.monotonic() < ends:
                now = time.monotonic()
                for ear, engine in zip(ears, (telling, following), strict=True):
                    ear.update(engine.performance.status(), now)
                if now >= due:
                    output.submit(f"set bells.b0.K {700 + len(apart) % 200}N/m now")
                    due += 1.0
                clocks = sent.copy()
                # Instants are compared with what is known of the sound at that moment.
                beat = (len(clocks) - 1) // 24
                if beat > done and ends - now < 60.0 * minutes:
                    number = np.array([beat])
                    late.append(
                        clocks[24 * beat][0] - float(_beat_instants(output, ears[0], number)[0])
                    )
                    both = [
                        float(_beat_instants(session, ear, number)[0])
                        for session, ear in zip((output, player_session), ears, strict=True)
                    ]
                    apart.append(both[1] - both[0])
                done = max(done, beat)
                time.sleep(0.003)
            gaps_in_sound = [gap_count(one.performance.status()) for one in (telling, following)]
            instants = np.array([at for at, _ in sent])
        finally:
            output.close()
            player_session.close()
    number = np.arange(len(instants))
    line = np.polyfit(number, instants, 1)
    uneven = np.abs(instants - np.polyval(line, number))
    return [
        Row("MIDI clock: gaps in the sound of both", f"{gaps_in_sound}", "none", None, ""),
        _row("clock told: late against the beat that is heard", np.array(late)),
        _row("clock told: every clock against an even pace", uneven),
        _row("clock followed: beats against the master's, both heard", np.array(apart)),
    ]


def _row(what: str, seconds: np.ndarray) -> Row:
    away = np.sort(np.abs(seconds)) * 1e3
    worst, limit, mid = away[-1], away[int(0.99 * (len(away) - 1))], float(np.median(away))
    text = f"median {mid:.2f} ms, 99 % {limit:.2f} ms, worst {worst:.2f} ms of {len(away)}"
    return Row(f"MIDI {what}", text, "1 ms a beat", float(limit), "ms at 99 %")
