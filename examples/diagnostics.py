"""Mistakes of a score as records, for a program that shows them in its own way."""

import json

import ergon

SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@120ms}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: kock}]}
"""


def diagnostics(score: str) -> list[dict[str, object]]:
    """The mistakes of a text that stands in no file."""
    checked = ergon.check("score.yaml", ergon.ReadOptions(text=score))
    return [
        {
            "code": result.code,
            "severity": result.severity,
            "line": result.place.line,
            "column": result.place.column,
            "message": result.message,
            "suggestion": result.suggestion,
        }
        for result in checked.diagnostics
    ]


if __name__ == "__main__":
    for diagnostic in diagnostics(SCORE):
        print(json.dumps(diagnostic))
