"""Output of commands: messages on stderr, data on stdout, JSON lines on request."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ergon.common.report import Progress, Report
from ergon.common.terminal import clean, json_text

from .colour import linked_code, style

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic, Severity, Source

    from .outcome import Outcome
VERSION = 1
Form = Literal["full", "concise", "github", "json"]


@dataclass(frozen=True, slots=True)
class Console(Report):
    """Prints messages and data in the form that the options of a command ask for."""

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    form: Form = "full"

    # --- data on stdout -------------------------------------------------------------------------

    def record(self, event: str, **fields: Any) -> None:
        """A JSON line on stdout."""
        print(json_line(event, **fields), flush=True)

    def data(self, text: str) -> None:
        """Text that was asked for, on stdout."""
        sys.stdout.write(clean(text))

    # --- messages on stderr ---------------------------------------------------------------------

    def say(self, message: str) -> None:
        """What happened; left out under --quiet and --json."""
        if not self.quiet and not self.json:
            print(clean(message), file=sys.stderr)

    def wrote(self, path: Path) -> None:
        """Say that a file was written."""
        if self.json:
            self.record("wrote", file=str(path))
        else:
            self.say(f"wrote {path}")

    def event(self, name: str, **fields: object) -> None:
        """A JSON line under --json alone."""
        if self.json:
            self.record(name, **fields)

    def detail(self, message: str) -> None:
        """Details of what happened, under --verbose only."""
        if self.verbose:
            self.say(message)

    def warn(self, message: str) -> None:
        """A warning: the work goes on."""
        if self.json:
            self.record("warning", message=message)
        elif not self.quiet:
            print(f"{style('warning', 'warning')}: {clean(message)}", file=sys.stderr)

    def outcome(self, outcome: Outcome) -> None:
        """An early end of a command, as one sentence or as one JSON line."""
        if not outcome.message:
            return
        if self.json:
            place = {"file": None, "line": None, "column": None, **outcome.place}
            suggestion = place.pop("suggestion", None)
            fields = {"code": outcome.code or None, **place, "message": outcome.message}
            self.record("error", **fields, suggestion=suggestion)
        else:
            code = outcome.code
            label = style("error", linked_code(f"error[{code}]", code) if code else "error")
            print(f"{label}: {clean(outcome.message)}", file=sys.stderr)

    def diagnostics(
        self,
        diagnostics: Iterable[Diagnostic],
        sources: Mapping[str, Source],
        left_out: Mapping[Severity, int],
    ) -> None:
        """Diagnostics with their places and lines from `sources`, and how many more there are.

        JSON and GitHub forms are data for another program and go to stdout, the others to
        stderr. Under --quiet only errors are shown.
        """
        from ergon.notation.text.errors import RENDERERS

        output_form: Form = "json" if self.json else self.form
        stream = sys.stdout if output_form in ("json", "github") else sys.stderr
        for diagnostic in diagnostics:
            if self.quiet and diagnostic.severity != "error":
                continue
            report_text = clean(RENDERERS[output_form](diagnostic, sources))
            if output_form in ("full", "concise"):
                label = f"{diagnostic.severity}[{diagnostic.code}]"
                link = linked_code(label, diagnostic.code)
                report_text = report_text.replace(label, style(diagnostic.severity, link), 1)
            print(_encodable(report_text) if output_form == "json" else report_text, file=stream)
        for severity, count in left_out.items():
            if count:
                self.say(f"and {count:,} more {severity}" + ("s" if count > 1 else ""))

    def waiting(self, task: str) -> AbstractContextManager[None]:
        """After a second, on a terminal, show the task and how long it has taken."""
        from .progress import waiting

        return waiting(clean(task), self.quiet or self.json)

    def progress(self, task: str, total: int, rate: float) -> Progress:
        """A bar on a terminal, a JSON record per second under --json, otherwise silence."""
        from .progress import bar

        return bar(clean(task), total, rate, self.quiet, self.record if self.json else None)


def json_line(event_name: str, **record_fields: Any) -> str:
    """One JSON line; a number that JSON does not have (inf, nan) becomes null.

    Characters that stdout cannot encode are escaped as in JSON, and so are bytes of file names
    that are not text.
    """
    record_fields = {name: _finite(value) for name, value in record_fields.items()}
    return _encodable(json_text({"v": VERSION, "event": event_name, **record_fields}))


def _encodable(text: str) -> str:
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        escaped: str = json.dumps(json.loads(text))
        return escaped
    return text


def _finite(json_value: Any) -> Any:
    """The value with None for numbers that JSON does not have."""
    if isinstance(json_value, float) and (
        json_value != json_value or json_value in (float("inf"), float("-inf"))
    ):
        return None
    if isinstance(json_value, dict):
        return {name: _finite(inner) for name, inner in json_value.items()}
    if isinstance(json_value, (list, tuple)):
        return [_finite(inner) for inner in json_value]
    return json_value


def plural(count: int, noun: str) -> str:
    """`1 error`, `2 errors`."""
    return f"{count:,} {noun}" + ("" if count == 1 else "s")
