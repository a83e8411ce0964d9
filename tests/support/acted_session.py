"""A session that only reports what it is asked, for tests of the prompt: it runs as its own
process.

    python acted_session.py LOG [--plain] [--strict] [--history FILE]

Every call is written to LOG, one JSON line each.
"""

import argparse
import json
import sys
import threading
import time
from pathlib import Path

from ergon.repl.prompt.run import run
from ergon.repl.session_protocol import Reply, State, Suggestion

VERBS = {"play": "start", "plays": "a player begins", "hush": "no more ergons", "help": "this"}


class Acted:
    def __init__(self, log: Path):
        self._log = log.open("a", encoding="utf-8")
        self._began = time.monotonic()
        self._messages: list[str] = []
        self._panicked = threading.Event()
        self._note("ready")

    def _note(self, what: str, **fields: object) -> None:
        self._log.write(json.dumps({"what": what, **fields}) + "\n")
        self._log.flush()

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        self._note("submit", text=text, **({} if releases else {"releases": False}))
        verb, _, rest = text.partition(" ")
        done = getattr(self, f"_{verb}", None)
        if done is None:
            return Reply(False, f"unknown verb {text[:40]!r}", try_="ada plays lean")
        return done(rest)

    def _ada(self, rest: str) -> Reply:
        return Reply(True, f"ok 2|1 ada: {rest}")

    def _slow(self, rest: str) -> Reply:
        """Run until a panic, or for some seconds."""
        stopped = self._panicked.wait(float(rest))
        return Reply(True, "stopped by the panic" if stopped else "slow is done")

    def _say(self, rest: str) -> Reply:
        """`say COUNT SECONDS WHAT`: after SECONDS send a message COUNT times; # in it becomes its
        number.
        """
        count, seconds, what = rest.split(" ", 2)

        def later() -> None:
            time.sleep(float(seconds))
            self._messages += [what.replace("#", str(n)) for n in range(int(count))]

        threading.Thread(target=later, daemon=True).start()
        return Reply(True, "ok, later")

    def _draw(self, rest: str) -> Reply:
        return Reply(True, "", lines=("⣀⡠⠤ a drawing", "\x1b[31m of two lines"))

    def _fail(self, rest: str) -> Reply:
        raise {"exit": SystemExit, "panic": PanicException}.get(rest, ValueError)("no such thing")

    def _print(self, rest: str) -> Reply:
        print(f"printed {rest}")
        return Reply(True, "ok")

    def _quit(self, rest: str) -> Reply:
        return Reply(True, "left", leaves=True)

    def state(self) -> State:
        beats = (time.monotonic() - self._began) * 4
        return State(
            bar=int(beats // 4) + 1,
            beat=beats % 4 + 1,
            tempo=240,
            playing=(("ada", "lean"),),
            load=0.12,
            late=3,
            level=-18.25,
            panicked=self._panicked.is_set(),
        )

    def messages(self) -> list[str]:
        messages, self._messages = self._messages, []
        return messages

    def panic(self) -> None:
        self._panicked.set()
        self._note("panic")

    def cancel(self) -> bool:
        self._note("cancel")
        return False

    def let_go(self) -> None:
        self._note("let go")

    def end_input(self) -> None:
        self._note("input ends")

    def close(self) -> None:
        self._note("close")
        self._messages.append("closed")

    def complete(self, line: str, cursor: int) -> list[Suggestion]:
        start = line.rfind(" ", 0, cursor) + 1
        word = line[start:cursor]
        return [Suggestion(verb, start, VERBS[verb]) for verb in VERBS if verb.startswith(word)]

    def tokens(self, line: str) -> list[tuple[int, int, str]]:
        if "unlucky" in line:
            raise ValueError("no colours")
        return [(0, 4, "name")] if line.startswith("play") else []

    def is_whole(self, text: str) -> bool:
        return not text.endswith("\\")


class PanicException(BaseException):
    """As PyO3's."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--strict", action="store_true")
    parser.add_argument("--history", type=Path)
    wishes = parser.parse_args()
    acted = Acted(wishes.log)
    sys.exit(run(acted, plain=wishes.plain, strict=wishes.strict, history=wishes.history))
