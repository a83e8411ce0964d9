"""A model of another program, made into a score that sounds the same sample for sample."""

import subprocess
import sys
from pathlib import Path

import ergon

# A mass on a spring, displaced at the beginning, in the language of mi-gen.
MODEL = """\
@g ground 0
@m mass 1 0.01 0
@s springDamper @g @m 0.01 0.001
@out1 posOutput @m
"""


def main(folder: Path) -> Path:
    """Import the model and look at its pitch; where the score is."""
    model, score = folder / "model.mdl", folder / "model.yaml"
    model.write_text(MODEL, encoding="utf-8")
    command = [sys.executable, "-m", "ergon", "import", str(model), "--dialect", "v2"]
    command += ["-o", str(score)]
    subprocess.run(command, check=True)
    for part in ergon.modes(score):
        print(f"{part.part}: {part.frequencies[0]:.2f} Hz")
    return score


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
