"""A chart in numbers: a CSV file, records, and a short table for the terminal."""

from __future__ import annotations

from dataclasses import fields as names_of

from ergon.workshop.lab import table
from ergon.workshop.lab.chart import Chart, Point
from ergon.workshop.lab.names import METRICS

_MEASURES = [f.name for f in names_of(Point) if f.name not in ("setting", "status", "reason")]


def csv(chart: Chart, title: str, machine: str) -> str:
    """The whole file."""
    rows = [point_fields(point) for point in chart.points]
    reference_text = ", ".join(f"{k} {v}" for k, v in reference(chart).items() if v is not None)
    facts = [
        f"chart of {title}, the first {chart.seconds:g} s at {chart.rate:g} Hz",
        f"measured on {machine}",
        "cost: seconds of one core per second of sound, median of interleaved rounds",
        f"reference: {reference_text or 'none'}",
        *(f"doubt: {doubt}" for doubt in chart.doubts),
        *(f"the same samples: {', '.join(group)}" for group in chart.identical_methods),
    ]
    names = [*_COLUMNS, *_MEASURES, "reason"]
    return table.csv_text(facts, names, ([row[name] for name in names] for row in rows))


_COLUMNS = ("method", "oversampling", "precision", "budget_db", "status")


def point_fields(point: Point) -> dict[str, table.Value]:
    """Everything about a point."""
    setting = point.setting
    identification = (
        setting.method or "planner",
        setting.oversampling,
        setting.precision,
        setting.budget_db,
        point.status,
    )
    measures = {name: getattr(point, name) for name in _MEASURES}
    return {**dict(zip(_COLUMNS, identification, strict=True)), **measures, "reason": point.reason}


def reference(chart: Chart) -> dict[str, table.Value]:
    """The reference, its order and its own error."""
    chart_reference = chart.reference
    if chart_reference is None:
        return {}
    return {
        "setting": str(chart_reference.setting),
        "changed_by_last_doubling_db": chart_reference.changes_db[-1],
        "order_seen": chart_reference.order,
        "own_error_db": chart_reference.floor_db,
        "floor_of_metric": chart.floor,
    }


def lines(chart: Chart) -> str:
    """One line a point: its cost and its errors; * is best for its cost."""
    rows = []
    for point in chart.points:
        error = point.error(chart.metric)
        mark = "*" if point.on_front else " "
        reason = f"  {point.reason}" if point.reason else ""
        if point.status != "ok":
            rows.append(f"  {point.setting!s:<14} {point.status}: {point.reason}\n")
        elif point.cost is not None:
            error_text = _error_text(chart, point, error)
            rows.append(f"{mark} {point.setting!s:<14} {point.cost:9.3g} {error_text:>9}{reason}\n")
    if chart.reference is not None:
        order = chart.reference.order
        order_text = "" if order is None else f", order {order:.1f} seen"
        rows.append(
            f"  reference: {chart.reference.setting}, own error about "
            f"{chart.reference.floor_db:.0f} dB of waveform{order_text}\n"
        )
    rows.extend(f"  {reason}\n" for reason in _notes(chart))
    rows.extend(
        f"  the same samples here: {', '.join(group)}\n" for group in chart.identical_methods
    )
    return f"{'':16}   s per s  {METRICS[chart.metric]}\n" + "".join(rows)


def _notes(chart: Chart) -> list[str]:
    """What a figure leaves open."""
    notes = []
    if any(point.is_bounded for point in chart.points):
        notes.append(
            "<: below what rounding makes, so no more is known"
            if chart.metric == "energy"
            else "<: below the error of the reference itself, so no more is known"
        )
    if any(_is_partial(chart, point) for point in chart.points):
        notes.append(
            "+: only what contacts and laws made is counted, not what they took too much; "
            "only ca keeps a ledger"
        )
    return notes


def _is_partial(chart: Chart, point: Point) -> bool:
    return chart.metric == "energy" and point.energy_of == "links"


def _error_text(chart: Chart, point: Point, error: float | None) -> str:
    """The error in the metric of the chart, no smaller than the reference's own."""
    if error is None:
        return "unknown"
    plus = "+" if _is_partial(chart, point) else ""
    if point.is_bounded and chart.floor is not None:
        return f"<{chart.floor:.3g}{plus}"
    return f"{error:.3g}{plus}"
