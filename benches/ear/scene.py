"""The scene `ear` of `python -m benches`."""

from __future__ import annotations

from collections.abc import Sequence

from benches.ear import page
from benches.ear.recorded import Recorded
from benches.ear.verdict import Verdict, judge
from benches.measure import Row
from docs.generators.cards import described


def ear(names: Sequence[str] = (), write: bool = False) -> list[Row]:
    """Judge some instruments, or all that are meant to be a known one; write the page if asked."""
    cards = {
        name: (family, card)
        for family, texts in described().items()
        for name, card in texts["cards"].items()
        if "ear" in card
    }
    if unknown := sorted(set(names) - set(cards)):
        raise SystemExit(f"no instrument {', '.join(unknown)} has a class; `ear` in cards.yaml")
    recorded = Recorded()
    verdicts: list[Verdict] = []
    for name, (family, card) in cards.items():
        if not names or name in names:
            verdicts.append(judge(recorded, family, name, card))
            print(f"{name} judged", flush=True)
    if write:
        if names:
            raise SystemExit("the page is about all instruments: leave --instruments out")
        pitches = {
            n: card["ear"]["pitch"] for n, (_, card) in cards.items() if "pitch" in card["ear"]
        }
        page.PAGE.write_text(page.text(recorded, verdicts, pitches), encoding="utf-8")
    return [_row(verdict) for verdict in verdicts]


def _row(v: Verdict) -> Row:
    ours = f"{v.distance:.2f} from {v.wanted}, rank {v.rank}, cost {v.cost:.2%} of a core"
    reference = (
        f"95 % of recordings within {v.distance_95:.2f}, another source within "
        f"{page.extent(v.distances_of_sources)}; taken for {v.taken_for}"
    )
    values = {"distance": v.distance, "rank": v.rank, "cost": v.cost, "taken for": v.taken_for}
    return Row(f"ear of {v.name}", ours, reference, v.distance / v.distance_95, _SENSE, values)


_SENSE = "distance over that of 95 % of recordings"
