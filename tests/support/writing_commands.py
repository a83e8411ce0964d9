"""Every command that writes files computed from others: its line, its files, and what it reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from commands import forked
from recordings import Axis, end, header, row, rows

SCORE = """\
ergon: 1
title: Written
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
mix: {channels: 2, route: [{from: bell, to: [1, 2]}]}
render: {bits: 24, tail: 10ms}
"""
RESONANCES = "465.239 -55.16879 0.2261643\n1621.073 -66.87767 0.5535431\n"


@dataclass(frozen=True)
class Writer:
    """A command, and the files that it writes."""

    line: str
    files: tuple[str, ...]

    @property
    def words(self) -> list[str]:
        return self.line.split()


def _writer(line: str, *files: str) -> Writer:
    return Writer(line, files)


WRITERS = (
    _writer("compile s.yaml -o e.csv", "e.csv"),
    _writer("render s.yaml -o x.wav", "x.wav"),
    _writer("render s.yaml -o x.flac", "x.flac"),
    _writer("render s.yaml -o x.wav --stems stems", "x.wav", "stems/01_bell.wav"),
    _writer("render s.yaml -o x.wav --motion", "x.wav", "x.motion"),
    _writer("render s.yaml --freeze bell -o frozen", "frozen/01_bell.wav", "frozen/frozen.json"),
    _writer("sweep s.yaml --vary seed=1 -o sw", "sw/seed=1.wav", "sw/sweep.csv", "sw/sweep.svg"),
    _writer("plan s.yaml -o p.json", "p.json"),
    _writer("modes s.yaml --csv m.csv --svg m.svg", "m.csv", "m.svg"),
    _writer("tune s.yaml bell A4 -o tuned.yaml", "tuned.yaml"),
    _writer("admittance s.yaml bell.m --csv a.csv --npz a.npz --svg a.svg",
            "a.csv", "a.npz", "a.svg"),
    _writer("bell resonances.txt -o bell.yaml", "bell.yaml"),
    _writer("plot s.yaml knock --svg g.svg", "g.svg"),
    _writer("plot in.wav --svg g.svg", "g.svg"),
    _writer("import in.mdl -o imported.yaml", "imported.yaml"),
    _writer("export s.yaml -o out", "out/tempo.mid", "out/marks.csv", "out/mix.wav",
            "out/stems/01_bell.wav", "out/project.rpp"),
    _writer("export s.yaml --to modal -o out", "out/bell.csv", "out/k1.csv"),
    _writer("export s.yaml --to faust -o out", "out/s.dsp"),
    _writer("export s.yaml --to mdl -o out", "out/s.mdl"),
    _writer("export s.yaml bell --to csound -o out", "out/bell.csd"),
    _writer("pack s.yaml -o s.ergonpack", "s.ergonpack"),
    _writer("take export in.take -o t.csv", "t.csv"),
    _writer("take export in.take -o t.npz", "t.npz"),
    _writer("take export in.take -o t.wav", "t.wav"),
    _writer("motion export in.motion -o m.csv", "m.csv"),
    _writer("motion export in.motion -o m.npz", "m.npz"),
    _writer("motion export in.motion -o m.gltf", "m.gltf"),
    _writer("fold in.wav --layout stereo --to ambix1 -o f.wav", "f.wav"),
    _writer("layout export stereo -o l.json", "l.json"),
    _writer("layout export stereo -o l.yaml", "l.yaml"),
    _writer("layout export stereo -o l.xml", "l.xml"),
    _writer("layout import in.json -o l.yaml", "l.yaml"),
    _writer("layout noise stereo --seconds 0.1 -o n.wav", "n.wav"),
    _writer("schema -o s.json", "s.json"),
    _writer("share in.motion -o p.html", "p.html"),
    _writer("demo --no-audio -o d.wav", "d.wav"),
    _writer("chart s.yaml --seconds 0.2 --upto 2 --methods ca -o c",
            "c.csv", "c.svg", "c.png"),
    _writer("stability s.yaml --seconds 0.05 -o c", "c.csv", "c.svg", "c.png"),
)  # fmt: skip

# These make folders, which must not exist before.
MAKERS = (
    _writer("new piece", "piece/README.md", "piece/score.yaml", "piece/score-1.schema.json",
            "piece/instruments/bell.yaml"),
    _writer("new --template duet deep/piece", "deep/piece/README.md", "deep/piece/score.yaml",
            "deep/piece/score-1.schema.json", "deep/piece/instruments/bells.yaml"),
)  # fmt: skip


def writers_of(*lines: str) -> list[Writer]:
    """The writers whose lines begin so."""
    return [one for one in (*MAKERS, *WRITERS) if one.line.startswith(lines)]


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder, hidden ones as well."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def make_inputs(folder: Path) -> None:
    """Write what the commands read."""
    (folder / "s.yaml").write_text(SCORE)
    (folder / "resonances.txt").write_text(RESONANCES)
    take = header() + rows(*(row(i, Axis(i * 1e-6)) for i in range(100))) + end()
    (folder / "in.take").write_bytes(take)
    for line in (
        "render s.yaml -o in.wav --motion",
        "export s.yaml --to mdl -o models",
        "layout export stereo -o in.json",
    ):
        done = forked(line.split(), folder)
        assert done.returncode == 0, done.stderr
    (folder / "models" / "s.mdl").rename(folder / "in.mdl")
    (folder / "models").rmdir()
