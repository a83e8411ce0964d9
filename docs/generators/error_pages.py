"""Pages that explain every code, with the checker's own words on real examples."""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from docs.generators.wrap import wrapped
from ergon import _core
from ergon.api import render as rendering
from ergon.api.simulate import never_closed_warnings, never_stuck_warnings, simulate
from ergon.api.strokes import closed_once_warnings
from ergon.common.module_arguments import module_arguments
from ergon.common.report import Report
from ergon.notation.text.errors import Diagnostic, full
from ergon.scores.reading.load import Loaded, load
from ergon.scores.staging.highest_modes import highest_modes, warn_low_modes, warn_over_limit
from ergon.scores.staging.implausible import warn_implausible
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage
from ergon.scores.staging.unused import warn_unused

_TABLE = Path(__file__).with_name("codes.yaml")
NAME = "score.yaml"  # what the examples are called


@dataclass(frozen=True, slots=True)
class Code:
    """One report: its meaning, a score that gets it, one that does not, and the files that they
    use.
    """

    code: str
    title: str
    why: str
    bad: str
    good: str
    files: dict[str, str | bytes] = field(default_factory=dict)


def rendered(loaded: Loaded) -> rendering.Completed:
    """The files written by rendering a score."""
    options = rendering.FileOptions()
    return rendering.write(rendering.prepare(loaded, "sound.wav", options, Report()), Report())


@cache
def codes() -> dict[str, Code]:
    """All codes that can be reported."""
    table = yaml.safe_load(_TABLE.read_text(encoding="utf-8"))
    return {code: Code(code, **entry) for code, entry in table.items()}


def reports_and_score(entry: Code, text: str) -> tuple[list[Diagnostic], Loaded]:
    """All reports about a text: when it is read, staged, and run for a second."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, content in entry.files.items():
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
        loaded = load(NAME, text=text)
        if loaded.piece is None:
            return loaded.diagnostics, loaded
        try:
            played = stage(loaded.piece, planned=True)
        except StageError as error:
            return [*loaded.diagnostics, *error.diagnostics], loaded
        reports = [*loaded.diagnostics, *warn_unused(loaded.piece), *warn_implausible(loaded.piece)]
        reports += played.diagnostics
        if entry.code == "W331":
            return [
                *reports,
                *warn_low_modes(highest_modes(loaded.piece, played.built_network)),
            ], loaded
        if entry.code == "W332":
            return [
                *reports,
                *warn_over_limit(loaded.piece, played.built_network, played.paths),
            ], loaded
        if entry.code in ("W320", "W323", "W334"):
            done = simulate(loaded.piece, NAME)
            reports += never_closed_warnings(loaded.piece, done) + closed_once_warnings(
                loaded.piece, done
            )
            return [*reports, *never_stuck_warnings(done)], loaded
        if entry.code in ("W324", "W325"):
            done_file = rendered(loaded)
            return [*reports, *done_file.faint], loaded
        frames = np.zeros((min(played.n_frames, int(played.rate)), played.simulation.n_out))
        try:
            played.simulation.process(frames)
        except _core.DivergedError as error:
            reports.append(played.fault_diagnostic(error))
        return [*reports, *played.energy_gains()], loaded


def reports_in_full(entry: Code, text: str) -> list[str]:
    """The reports with this code alone, in full."""
    reports, loaded = reports_and_score(entry, text)
    return [full(d, loaded.files) for d in reports if d.code == entry.code]


def page(entry: Code) -> str:
    """One page in Markdown."""
    messages = reports_in_full(entry, entry.bad)
    if not messages:
        raise AssertionError(f"the example of {entry.code} does not get it")
    files = "".join(_shown(name, content) for name, content in entry.files.items())
    return (
        f"# {entry.code}: {entry.title}\n\n"
        f"{entry.why.strip()}\n\n"
        f"```yaml\n{entry.bad.rstrip()}\n```\n\n"
        f"{files}"
        f"The checker says:\n\n"
        f"```text\n{chr(10).join(messages)}\n```\n\n"
        f"Corrected:\n\n"
        f"```yaml\n{entry.good.rstrip()}\n```\n"
    )


def _shown(name: str, content: str | bytes) -> str:
    if isinstance(content, bytes):
        kind = " of a recording" if name.endswith(".take") else ""
        return f"with `{name}`, {len(content)} bytes{kind},\n\n"
    return f"with `{name}`:\n\n```yaml\n{content.rstrip()}\n```\n\n"


def pages() -> dict[str, str]:
    """All pages by file name, with an index."""
    text_by_file = {f"{entry.code}.md": wrapped(page(entry)) for entry in codes().values()}
    rows = "\n".join(f"| [{c.code}]({c.code}.md) | {c.title} |" for c in codes().values())
    text_by_file["README.md"] = (
        "# What the checker says\n\n"
        "E is an error, W a warning, N a note. "
        "Made by `make docs`.\n\n"
        f"| code | title |\n|---|---|\n{rows}\n"
    )
    return text_by_file


def write(folder: str | Path) -> None:
    """Write the pages into a folder."""
    path = Path(folder)
    path.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (path / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(module_arguments("FOLDER")[0])
