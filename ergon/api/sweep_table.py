"""The table of a sweep: a CSV file that a later run continues."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ergon.common.regular import read_bounded
from ergon.exchange.safe import MARK, write_text

# The columns of figures, and what each means.
FIGURES: Mapping[str, str] = {
    "seconds": "length of the sound [s]",
    "loudness_lufs": "integrated loudness [LUFS]",
    "peak_db": "highest sample [dBFS]",
    "centroid_hz": "mean frequency by power [Hz]",
    "pitch_hz": "pitch of the loudest 0.2 s [Hz]",
    "partial_hz": "strongest partial [Hz]",
    "t60_s": "decay after the last loud blow [s]",
    "cpu_s": "work of the render [CPU s]",
    "x_real_time": "speed [× real time]",
    "plan_cost": "work by the table of costs [s per s of sound]",
    "error_db": "largest error of the plan [dB]",
    "error_cents": "largest error of a pitch of the plan [cents]",
}
_FIRST_COLUMNS, _LAST_COLUMNS = ("status", "file"), ("score_sha256", "file_sha256", "reason")
_BYTES_MAX = 50_000_000
_SAVE_INTERVAL_SECONDS = 1.0  # [s] between two tables of an unfinished sweep


@dataclass(frozen=True, slots=True)
class SweepRow:
    """A variant: its values as texts, what became of it ("ok", "refused", "diverged"), the file of
    its sound and the `figures`; `digest` is the hash of the score, its files and the options,
    `sha256` that of the file, `reason` the sentence where it failed.
    """

    values: tuple[str, ...]
    status: str
    file: str
    figures: Mapping[str, float | None]
    digest: str
    sha256: str
    reason: str


class Table:
    """The file of a sweep's table; `targets` are the columns of values."""

    def __init__(self, path: Path, targets: tuple[str, ...]) -> None:
        """Nothing is read or written yet."""
        self.path, self.targets = path, targets
        self._save_instant = float("-inf")

    def read(self) -> dict[str, SweepRow]:
        """The rows of an earlier run by their digest; none if the file is damaged or not ours."""
        try:
            file_bytes = read_bounded(self.path, _BYTES_MAX)
        except OSError:
            return {}
        if MARK not in file_bytes[:1024] or len(file_bytes) > _BYTES_MAX:
            return {}
        csv_lines = [
            line for line in file_bytes.decode(errors="replace").splitlines() if line[:1] != "#"
        ]
        rows_by_digest: dict[str, SweepRow] = {}
        try:
            for fields in csv.DictReader(csv_lines):
                row = _sweep_row(fields)
                rows_by_digest[row.digest] = row
        except (ValueError, KeyError, TypeError, csv.Error):
            return {}
        return rows_by_digest

    def write_unfinished(self, rows: Sequence[SweepRow], *, force: bool) -> None:
        """Write an unfinished table, at most once a second."""
        instant_now = time.monotonic()
        if instant_now - self._save_instant >= _SAVE_INTERVAL_SECONDS:
            self.write(rows, "", force=force)
            self._save_instant = instant_now

    def write(self, rows: Sequence[SweepRow], title: str, *, force: bool) -> None:
        """Write the whole table."""
        csv_text = io.StringIO()
        comment_lines = ["made by ergon", f"sweep of {' '.join(title.split())}"] if title else []
        comment_lines = comment_lines or ["made by ergon", "a sweep that is not finished"]
        comment_lines += [f"{name}: {meaning}" for name, meaning in FIGURES.items()]
        csv_text.writelines(f"# {comment_line}\n" for comment_line in comment_lines)
        csv_table = csv.writer(csv_text, lineterminator="\n")
        csv_table.writerow((*self.targets, *_FIRST_COLUMNS, *FIGURES, *_LAST_COLUMNS))
        for sweep_row in rows:
            figures = ["" if x is None else f"{x:.8g}" for x in map(sweep_row.figures.get, FIGURES)]
            reason = " ".join(sweep_row.reason.split())
            last_cells = (sweep_row.digest, sweep_row.sha256, reason)
            csv_table.writerow(
                (*sweep_row.values, sweep_row.status, sweep_row.file, *figures, *last_cells)
            )
        write_text(self.path, csv_text.getvalue(), force=force)


def _sweep_row(row_fields: Mapping[str, str]) -> SweepRow:
    figures = {name: float(row_fields[name]) if row_fields[name] else None for name in FIGURES}
    file_name = row_fields["file"]
    if file_name and Path(file_name).name != file_name:
        raise ValueError(file_name)
    last_fields = (row_fields["score_sha256"], row_fields["file_sha256"], row_fields["reason"])
    return SweepRow((), row_fields["status"], file_name, figures, *last_fields)
