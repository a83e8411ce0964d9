"""`ergon repl` for tests, with time, devices and MIDI port controlled by a test: PIPE SCORE [OPTION
…].

Commands in the pipe: `bar N` computes the piece up to a bar, `midi HEX` sends a message to the
session's port, `lose` unplugs zoe's device, `find` plugs it in again. Between commands time
hardly advances.
"""

import queue
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

from paced_board import Paced, paced

from ergon.api import local_session
from ergon.cli.app import main
from ergon.live import midi_ports
from ergon.live.perform import PlaybackConfig
from ergon.repl.session import computing, making_time
from ergon.repl.session.session import Session

_PERIODS = 10  # of 1 ms, between two looks of the session at its engine
# [s] between two periods while idle: a board that is silent for a second counts as lost.
_BEAT = 0.2


class Driver:
    """Advances time, and runs the commands of the pipe."""

    def __init__(self, boards: list[Paced], port: midi_ports.ProcessPort, pipe: Path) -> None:
        self.boards, self.port, self.pipe = boards, port, pipe
        self.paces = list(boards)  # that answer only as time passes
        self.session: Session | None = None

    def begins(self, session: Session) -> None:
        """Runs in place of the thread that attends to the engine."""
        self.session = session
        threading.Thread(target=self.follow, daemon=True).start()

    def follow(self) -> None:
        lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, args=(lines.put,), daemon=True).start()
        while True:
            try:
                word, *rest = lines.get(timeout=_BEAT).split()
            except queue.Empty:
                self.passes(1)
            else:
                getattr(self, word)(*rest)

    def _read(self, put) -> None:
        with self.pipe.open(encoding="ascii") as pipe:
            for line in pipe:
                put(line)

    def bar(self, number: str) -> None:
        while self.session.state().bar < int(number):
            self.passes()

    def midi(self, data: str) -> None:
        self.port.send(bytes.fromhex(data))
        self.passes()

    def lose(self) -> None:
        lost = self.boards[1]
        self.paces.remove(lost)
        lost.leave()
        lost.free()
        self._until(lambda: "zoe" in self.session.schedule.engine.status().disconnected)

    def find(self) -> None:
        self.boards[1].come()
        self._until(lambda: not self.session.schedule.engine.status().disconnected)

    def _until(self, true) -> None:
        while not true():
            self.passes()
            time.sleep(0.001)  # a device is looked for again by the wall's clock

    def passes(self, periods: int = _PERIODS) -> None:
        """Advance every board by a few periods, and let the session look at its engine."""
        for board in self.paces:
            board.may(periods)
        for board in self.paces:
            board.wait()
        self.session.do_once()
        if (path := self.session.guidance.due_paths()) is not None:
            with self.session.lock:
                self.session.guidance.send(*path)


def by_frames(config: PlaybackConfig) -> PlaybackConfig:
    """An output file that takes frames as they are computed, not by the wall clock."""
    return replace(config, audio=config.audio.replace("clock:", "file:", 1))


if __name__ == "__main__":
    computing.LINE_STEPS = computing.FILES_STEPS = 1 << 60
    making_time._SAFETY_FACTOR = 0.0  # time stands still while a line is computed
    hand = {"stiffness": 900.0, "sine": 5e-3}
    with paced(hertz=2.0, **hand) as first, paced(hertz=3.0, **hand) as two:
        port = midi_ports.ProcessPort()
        midi_ports.SystemInput = lambda name: port
        config = local_session._performance_config
        local_session._performance_config = lambda *given: by_frames(config(*given))
        driver = Driver([first, two], port, Path(sys.argv[1]))
        Session.run = lambda session: driver.begins(session)
        live = [f"remi={first.url}", f"zoe={two.url}"]
        sys.argv = ["ergon", "repl", *sys.argv[2:], *(w for url in live for w in ("--live", url))]
        main()
