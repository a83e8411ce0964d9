"""Mistakes of a score as records, for a program that shows them in its own way."""

import json
import subprocess
import sys

SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@120ms}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: kock}]}
"""


def diagnostics(score: str) -> list[dict[str, object]]:
    """What `ergon check` finds in a text."""
    command = [sys.executable, "-m", "ergon.cli", "check", "--json", "-"]
    done = subprocess.run(command, input=score, capture_output=True, text=True, check=False)
    return [json.loads(line) for line in done.stdout.splitlines()]


if __name__ == "__main__":
    for found in diagnostics(SCORE):
        print(json.dumps(found))
