"""What a test needs and a machine may lack: without it the test is skipped, with the command that
brings it.

`pytest --no-skips`, as `.ci/run` runs it, makes every skipped test a failure. Otherwise the last
lines of a run name the skipped tests and what would bring them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import programs
import pytest


def needs(*names: str) -> pytest.MarkDecorator:
    """A mark for tests that start programs of the table in `programs.py`."""
    absent = programs.missing(*names)
    return pytest.mark.skipif(bool(absent), reason=_reason(absent) if absent else "")


def program(name: str) -> str:
    """The path of a program; where it is missing, the test that asks is skipped."""
    path = programs.path_of(name)
    if path is None:
        pytest.skip(_reason([name]))
    return path


def _reason(absent: list[str]) -> str:
    return f"{' and '.join(absent)} missing: {programs.remedy(absent)}"


def as_failure(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Make the report of a skipped test that of a failed one. Expected failures stay."""
    if report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which --no-skips forbids: {_reason_of(report)}"


def skipped_lines(reports: Iterable[pytest.TestReport | pytest.CollectReport]) -> list[str]:
    """The lines that name skipped tests, by the reason."""
    tests: dict[str, set[str]] = defaultdict(set)
    for report in reports:
        tests[_reason_of(report)].add(report.nodeid.partition("[")[0])
    return [
        line
        for reason, names in sorted(tests.items())
        for line in (reason, *(f"    {name}" for name in sorted(names)))
    ]


def _reason_of(report: pytest.TestReport | pytest.CollectReport) -> str:
    place = report.longrepr
    reason = place[2] if isinstance(place, tuple) else str(place)
    return reason.removeprefix("Skipped: ")
