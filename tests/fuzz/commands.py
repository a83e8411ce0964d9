"""Scores by chance through every command that reads one: no command says that the fault is ergon's.

What `check` accepts every command accepts, but for a part that diverges while it is computed; what
`check` refuses every command refuses.
"""

from __future__ import annotations

import contextlib
import io
import random
from collections.abc import Iterator
from pathlib import Path

from one_bell import SCORE as BELL
from random_scores import Score

from benches.mutated import bases, mutated
from ergon.api.check import try_stage
from ergon.cli import app
from ergon.common.report import Report
from ergon.scores.reading.load import load
from tests.fuzz.texts import damaged

COMMANDS = (
    ("info",),
    ("check", "--simulate"),
    ("compile", "-o", "ergons.csv", "-f"),
    ("export", "-o", "exported", "-f"),
    ("render", "-o", "x.wav", "-f"),
)
DIVERGED = 4  # the exit code where a part goes beyond all bounds
MAX_WORK = 3e5  # masses × frames of a score that every command computes


def case(chance: random.Random) -> str:
    """A score with extreme numbers or small damages; most can still be played."""
    kind = chance.randrange(10)
    text = Score(chance.randrange(1 << 30)).text if kind < 5 else BELL
    if kind >= 8:
        text = chance.choice(list(bases().values()))
    if chance.random() < 0.8:
        return mutated(text, chance)
    return damaged(text, chance)


def read(text: str, folder: Path) -> Iterator[str]:
    """What each command prints about a score."""
    with contextlib.chdir(folder):
        Path("s.yaml").write_bytes(text.encode(errors="replace"))
        loaded = load("s.yaml")
        staged, _ = try_stage(loaded, Report())
        accepted = staged is not None
        if staged is not None and staged.n_frames * (1 + staged.network.n_mat) > MAX_WORK:
            return
        code, output = _run("check", "s.yaml")
        yield output
        assert (code == 0) == accepted, f"check ends with {code}"
        commands = [(name, "s.yaml", *options) for name, *options in COMMANDS]
        if loaded.piece is not None:
            names = (*loaded.piece.gestures, *loaded.piece.takes)[:2]
            commands += [("plot", "s.yaml", name) for name in names]
        for command in commands:
            code, output = _run(*command)
            yield output
            if accepted and command[0] != "plot":
                assert code in (0, DIVERGED), f"{command[0]} ends with {code}: {output[-300:]}"
            elif not accepted and command[0] != "plot":
                assert code not in (0, DIVERGED), f"{command[0]} accepts it"


def _run(*arguments: str) -> tuple[int, str]:
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        code = app.run(list(arguments))
    return code, output.getvalue()
