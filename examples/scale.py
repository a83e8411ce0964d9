"""A score made by a program: a scale of struck cells, rendered into a WAV file."""

import sys
import tempfile
from pathlib import Path

import ergon

PITCHES = [220.0 * 2 ** (step / 12) for step in (0, 2, 4, 5, 7, 9, 11, 12)]


def score() -> str:
    """One CEL for each pitch, struck one after the other."""
    lines = ["ergon: 1", "title: A scale", "instruments:", "  bells:", "    modules:"]
    for number, pitch in enumerate(PITCHES):
        lines.append(f"      m{number}: {{CEL: {{M: 2g, f: {pitch:.3f}Hz, t60: 1s}}}}")
    names = ", ".join(f"m{number}" for number in range(len(PITCHES)))
    lines += [f"    out: {{SOX: [{names}]}}", "strikes:"]
    for number in range(len(PITCHES)):
        lines.append(f"  s{number}: {{to: bells.m{number}, at: {number}, impulse: 1mNs}}")
    return "\n".join(lines) + "\n"


def main(target: str) -> None:
    """Render the score; `ergon.ScoreError` says what is wrong with it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scale.yaml"
        path.write_text(score(), encoding="utf-8")
        done = ergon.render_to_file(path, target, ergon.FileOptions(force=True))
        print(f"{done.mix.path}: peak {done.mix.peak:.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:] or ["scale.wav"])
