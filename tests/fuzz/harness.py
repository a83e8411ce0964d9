"""The rule for every reader: whatever it is given, an answer or a documented refusal."""

from __future__ import annotations

import contextlib
import random
import re
import signal
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# Words that no answer and no refusal contains: they stand for a mistake of the program.
BROKEN = re.compile(r"internal error|Traceback \(most recent|in ergon itself| object at 0x")


@dataclass(frozen=True, slots=True)
class Target:
    """A reader and how it is fuzzed.

    `case` makes what is read, from chance alone; `read` reads it in a folder of its own and gives
    every text that a person would be shown; `refusals` are the exceptions that its docstring names.
    `limit` is the most CPU time of a case [s]: no other process makes a case slower by it. A short
    run begins with the case `short_first`.
    """

    name: str
    case: Callable[[random.Random], Any]
    read: Callable[[Any, Path], Iterable[str] | None]
    refusals: tuple[type[BaseException], ...]
    short: int
    long: int = 100_000
    limit: float = 10.0
    short_first: int = 0
    is_silent: bool = False  # its refusals are counted, and nobody is shown a sentence


@dataclass(slots=True)
class Outcome:
    """Faults of a run by what went wrong, each with the first case that showed it."""

    cases: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest: tuple[float, int] = (0.0, -1)  # CPU time [s], case
    faults: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        rate = self.cases / max(self.seconds, 1e-9)
        slow, position = self.slowest
        text = f"{self.cases:,} cases, {rate:,.0f} a second, {self.refused:,} refused, "
        text += f"slowest {slow:.2f} s (case {position}), {sum(self.faults.values())} faults"
        return text + "".join(
            f"\n  {count} times, first in case {self.first[what]}: {what}"
            for what, count in self.faults.most_common()
        )


class TooLongError(BaseException):
    """A case took more CPU time than its target allows."""


def dice(target: Target, number: int) -> random.Random:
    """The chance of one case: the same whatever ran before it."""
    return random.Random(f"{target.name} {number}")


def fuzz(target: Target, count: int, folder: Path, first: int = 0) -> Outcome:
    """Run the cases `first` … `first + count - 1` of a target."""
    outcome = Outcome()
    began = time.monotonic()
    for number in range(first, first + count):
        case = target.case(dice(target, number))
        before = time.process_time()
        what = fault(target, case, folder, outcome)
        spent = time.process_time() - before
        outcome.slowest = max(outcome.slowest, (spent, number))
        outcome.cases += 1
        if what is not None:
            outcome.faults[what] += 1
            outcome.first.setdefault(what, number)
    outcome.seconds = time.monotonic() - began
    return outcome


def fault(target: Target, case: Any, folder: Path, outcome: Outcome) -> str | None:
    """What one case does wrong, if anything."""
    try:
        with _limited(target.limit):
            message = list(target.read(case, folder) or ())
    except target.refusals as error:
        outcome.refused += 1
        message = [str(error)]
        if not message[0].strip() and not target.is_silent:
            return f"{type(error).__name__} says nothing"
    except KeyboardInterrupt:
        raise
    except TooLongError as error:
        return f"more than {target.limit:g} s of CPU time, {_place(error)}"
    except BaseException as error:  # a panic of the core is no Exception
        return f"{type(error).__name__}: {re.sub('[0-9]+', '#', str(error))[:100]}, {_place(error)}"
    for text in message:
        if result := BROKEN.search(text):
            return f"says {result.group()!r}: {text[:200]}"
    return None


def _place(error: BaseException) -> str:
    """The innermost line of the program's own that an exception went through."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if "tests" not in frame.filename
    ]
    return f"{frames[-1].filename}:{frames[-1].lineno}" if frames else "in the tests"


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TooLongError once this process has computed for so long; the core ends then too."""

    def over(*_: object) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGPROF, over)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
