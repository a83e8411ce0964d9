"""A piece for eight loudspeakers, folded to two ears for headphones."""

import sys
from pathlib import Path

import ergon

SCORE = """\
ergon: 1
instruments:
  sky:
    modules: {stars: {BANK: {count: 16, f: A4..A6, t60: 1s, M: 1g, place: spiral}}}
    out: {SOX: stars.all}
strikes: {rain: {to: sky.stars.all, at: 1|1, rate: 0.5Hz, for: 4, impulse: 0.1mNs..1mNs}}
mix:
  layout: layouts/dome8.yaml
  route: [{from: sky, to: nearest}]
  master: {normalise: -6dB}
"""


def main(folder: Path) -> Path:
    """Render the piece and fold it; where the folded file is."""
    path = folder / "sky.yaml"
    path.write_text(SCORE, encoding="utf-8")
    wide = ergon.render_to_file(path, folder / "sky.wav")
    target = folder / "headphones.wav"
    folded = ergon.fold_file(wide.mix.path, target, "binaural")
    print(f"{folded.n_channels} channels, true peak {folded.true_peak:.2f}")
    return target


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:])))
