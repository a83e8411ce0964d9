"""A chart in numbers: a CSV file, records, and a short table for the terminal."""

from __future__ import annotations

from dataclasses import fields as names_of

from ergon.workshop.lab import table
from ergon.workshop.lab.chart import Chart, Point
from ergon.workshop.lab.names import METRICS

_MEASURES = [f.name for f in names_of(Point) if f.name not in ("setting", "status", "reason")]


def csv(chart: Chart, chart_title: str, machine: str) -> str:
    """The whole file."""
    table_rows = [fields(point) for point in chart.points]
    reference_text = ", ".join(f"{k} {v}" for k, v in reference(chart).items() if v is not None)
    facts = [
        f"chart of {chart_title}, the first {chart.seconds:g} s at {chart.rate:g} Hz",
        f"measured on {machine}",
        "cost: seconds of one core per second of sound, median of interleaved rounds",
        f"reference: {reference_text or 'none'}",
        *(f"doubt: {doubt}" for doubt in chart.doubts),
        *(f"the same samples: {', '.join(group)}" for group in chart.alike),
    ]
    names = [*_HEAD, *_MEASURES, "reason"]
    return table.text(facts, names, ([row[name] for name in names] for row in table_rows))


_HEAD = ("method", "oversampling", "precision", "budget_db", "status")


def fields(chart_point: Point) -> dict[str, table.Value]:
    """Everything about a point."""
    setting = chart_point.setting
    first_fields = (
        setting.method or "planner",
        setting.oversampling,
        setting.precision,
        setting.budget_db,
        chart_point.status,
    )
    measures = {name: getattr(chart_point, name) for name in _MEASURES}
    return {**dict(zip(_HEAD, first_fields, strict=True)), **measures, "reason": chart_point.reason}


def reference(chart: Chart) -> dict[str, table.Value]:
    """The reference, its order and its own error."""
    reference_chart = chart.reference
    if reference_chart is None:
        return {}
    return {
        "setting": str(reference_chart.setting),
        "changed_by_last_doubling_db": reference_chart.changes[-1],
        "order_seen": reference_chart.order,
        "own_error_db": reference_chart.floor_db,
        "floor_of_metric": chart.floor,
    }


def lines(chart: Chart) -> str:
    """One line a point: its cost and its errors; * is best for its cost."""
    table_rows = []
    for chart_point in chart.points:
        error = chart_point.error(chart.metric)
        star = "*" if chart_point.on_front else " "
        reason_note = f"  {chart_point.reason}" if chart_point.reason else ""
        if chart_point.status != "ok":
            table_rows.append(
                f"  {chart_point.setting!s:<14} {chart_point.status}: {chart_point.reason}\n"
            )
        elif chart_point.cost is not None:
            shown = _shown(chart, chart_point, error)
            table_rows.append(
                f"{star} {chart_point.setting!s:<14} {chart_point.cost:9.3g} "
                f"{shown:>9}{reason_note}\n"
            )
    if chart.reference is not None:
        order = chart.reference.order
        order_text = "" if order is None else f", order {order:.1f} seen"
        table_rows.append(
            f"  reference: {chart.reference.setting}, own error about "
            f"{chart.reference.floor_db:.0f} dB of waveform{order_text}\n"
        )
        if any(point.is_bounded for point in chart.points):
            table_rows.append("  <: below the error of the reference itself, so no more is known\n")
    table_rows.extend(f"  the same samples here: {', '.join(group)}\n" for group in chart.alike)
    return f"{'':16}   s per s  {METRICS[chart.metric]}\n" + "".join(table_rows)


def _shown(chart: Chart, chart_point: Point, error: float | None) -> str:
    """The error in the metric of the chart, no smaller than the reference's own."""
    if error is None:
        return "unknown"
    if chart_point.is_bounded and chart.floor is not None:
        return f"<{chart.floor:.3g}"
    return f"{error:.3g}"
