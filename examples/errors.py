"""What goes wrong, and which exception says so: a mistake, an option, a file, a motion."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: A4, t60: 1s}}}, out: {SOX: m}}
strikes: {tap: {to: bell.m, at: 1|1, impulse: 2mNs}}
mix: {route: [{from: bell, to: 1}]}
"""


def main(folder: Path) -> list[str]:
    """Try what cannot be done; the sentences of the exceptions."""
    path = folder / "bell.yaml"
    path.write_text(SCORE, encoding="utf-8")
    (folder / "mine.wav").write_text("not a sound of ergon", encoding="utf-8")
    attempts = {
        "a mistake": (path, None, ergon.FileOptions(text=SCORE.replace("A4", "H4"))),
        "an option": (path, folder / "a.wav", ergon.FileOptions(from_="nine")),
        "a file": (path, folder / "mine.wav", ergon.FileOptions()),
    }
    sentences = []
    for name, (score, target, options) in attempts.items():
        try:
            ergon.render_to_file(score, target, options)
        except ergon.ErgonError as error:  # ScoreError, OptionError, FileRefusedError
            sentences.append(f"{name}: {type(error).__name__}: {error}")
    return sentences


if __name__ == "__main__":
    print("\n".join(main(Path(*sys.argv[1:]))))
