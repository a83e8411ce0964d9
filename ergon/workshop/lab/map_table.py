"""Maps in numbers: a CSV file, records, and a few lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields as names_of

from ergon.workshop.lab import table
from ergon.workshop.lab.maps import Map, Spot, disagreements

_SPOT_FIELDS = [f.name for f in names_of(Spot) if f.name not in ("x", "y")]
Surveyed = Mapping[str, tuple[Map, Sequence[Spot]]]


def csv(surveyed: Surveyed, method: str) -> str:
    """The whole file: a row for every spot of every map."""
    facts = [
        f"stability of {method}",
        "theory, certified: predicted by a formula, by the engine before it runs",
        *dict.fromkeys(
            f"stable: what happened; accurate: {_accuracy_criterion(surveyed_map)}"
            for surveyed_map, _ in surveyed.values()
        ),
        *(
            f"{name}: x is {surveyed_map.x_label}, y is {surveyed_map.y_label}"
            for name, (surveyed_map, _) in surveyed.items()
        ),
    ]
    names = ["map", "x", "y", *_SPOT_FIELDS]
    rows = ([record[name] for name in names] for record in records(surveyed))
    return table.csv_text(facts, names, rows)


def _accuracy_criterion(surveyed_map: Map) -> str:
    *steps, (_, last_limit) = surveyed_map.error_limits
    limits_below = [f"{db:g} dB up to {y:g}, " for y, db in steps]
    metric_field = "energy_db" if surveyed_map.metric == "energy" else "error_db"
    return f"{metric_field} of at most {''.join(limits_below)}{last_limit:g} dB"


def records(surveyed: Surveyed) -> list[dict[str, table.Value]]:
    """Everything about every spot."""
    return [
        {
            "map": name,
            "x": spot.x,
            "y": spot.y,
            **{spot_field: getattr(spot, spot_field) for spot_field in _SPOT_FIELDS},
        }
        for name, (_, spots) in surveyed.items()
        for spot in spots
    ]


def lines(surveyed: Surveyed) -> str:
    """One line a map: how many spots are stable, how many accurate, and where predictions
    failed.
    """
    rows = []
    for map_name, (surveyed_map, spots) in surveyed.items():
        n_stable = sum(1 for spot in spots if spot.stable)
        n_accurate = sum(1 for spot in spots if spot.accurate)
        n_runaways, n_needless = disagreements(spots)
        sentence = (
            f"{map_name}: {surveyed_map.title}. Of {len(spots)} spots {n_stable} are stable, "
            f"{n_accurate} "
            "accurate"
        )
        if n_runaways:
            sentence += f"; {n_runaways} ran away though certified"
        if n_needless:
            sentence += f"; {n_needless} stayed though refused"
        if n_not_run := sum(1 for spot in spots if spot.stable is None):
            sentence += f"; {n_not_run} could not be run"
        rows.append(sentence + "\n")
    return "".join(rows)
