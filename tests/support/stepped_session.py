"""The prompt over a session whose engine the test steps: SCORE PIPE.

Each number read from the pipe is a bar, up to which the piece is then computed; otherwise it
stands still. The session's journal is `session.jsonl` beside the score.
"""

import sys
import threading
from pathlib import Path

from sessions import Stepped

from ergon.repl.prompt.run import run

_STEP = 0.05  # [s] of sound between two looks at the bar


def follow(stepped: Stepped, bars: Path) -> None:
    """Compute the piece up to each bar that the pipe names."""
    with bars.open(encoding="ascii") as pipe:
        for line in pipe:
            while stepped.session.state().bar < int(line):
                with stepped.session.lock:
                    stepped.run(_STEP)


if __name__ == "__main__":
    score, bars = map(Path, sys.argv[1:])
    stepped = Stepped(score.read_text(encoding="utf-8"), score.parent, name=score.name)
    threading.Thread(target=follow, args=(stepped, bars), daemon=True).start()
    sys.exit(run(stepped.session, history=None))
