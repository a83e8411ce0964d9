"""Audits of many scenes as tables of a page."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from accuracy.audit import BUDGETS, Audit, Plan


@dataclass(frozen=True)
class Tally:
    """Counts of plans of some scenes at one budget: all, judged, met, and so on.

    `worst`: real error over the stated one [dB]; `median` and `maximum` of the overspending.
    `inversions` and `false_cannot` are None where nobody counted them.
    """

    plans: int
    judged: int
    met: int
    warned: int
    silent: int
    worst: float | None
    median: float | None
    maximum: float | None
    inversions: int | None = None
    false_cannot: int | None = None


def name_of(budget: float | None) -> str:
    return "by ear" if budget is None else f"{budget:g} dB"


def tallies(audits: Sequence[Audit]) -> list[Tally]:
    """One for each budget."""
    return [_tally([(audit, audit.plans[i]) for audit in audits]) for i in range(len(BUDGETS))]


def _tally(pairs: Sequence[tuple[Audit, Plan]]) -> Tally:
    judged = [(audit, plan) for audit, plan in pairs if plan.is_judged]

    def count(holds: Callable[[Plan], bool]) -> int:
        return sum(holds(plan) for _, plan in judged)

    spent = [audit.overspending(plan) for audit, plan in judged]
    ratios = sorted(ratio for ratio in spent if ratio is not None)
    return Tally(
        plans=len(pairs),
        judged=len(judged),
        met=count(lambda plan: plan.is_met),
        warned=count(lambda plan: plan.warned),
        silent=count(lambda plan: plan.is_silent_miss),
        worst=max((plan.excess for _, plan in judged if plan.stated < inf), default=None),
        median=ratios[len(ratios) // 2] if ratios else None,
        maximum=ratios[-1] if ratios else None,
        inversions=sum(audit.is_inverted(plan) for audit, plan in judged),
        false_cannot=sum(audit.is_false_cannot(plan) for audit, plan in judged),
    )


def together(all_of_them: Sequence[Tally]) -> Tally:
    """All scenes of some tallies; the common median cannot be computed from their medians."""
    return Tally(
        plans=sum(own.plans for own in all_of_them),
        judged=sum(own.judged for own in all_of_them),
        met=sum(own.met for own in all_of_them),
        warned=sum(own.warned for own in all_of_them),
        silent=sum(own.silent for own in all_of_them),
        worst=max((own.worst for own in all_of_them if own.worst is not None), default=None),
        median=None,
        maximum=max((own.maximum for own in all_of_them if own.maximum is not None), default=None),
        inversions=_counted([own.inversions for own in all_of_them]),
        false_cannot=_counted([own.false_cannot for own in all_of_them]),
    )


def _counted(counts: Sequence[int | None]) -> int | None:
    """The sum of the counts that are known; None if none is."""
    known = [count for count in counts if count is not None]
    return sum(known) if known else None


def summary(groups: Mapping[str, Sequence[Tally]]) -> str:
    """A row for each group of scenes and budget, and for all of them."""
    lines = [
        "| scenes | budget | plans | judged | met | says it cannot | silent misses "
        "| false cannot | inversions | real − stated, worst | overspending: median | worst |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    everything = [together(item) for item in zip(*groups.values(), strict=True)]
    for name, item in (*groups.items(), ("all", everything)):
        for budget, tally in zip(BUDGETS, item, strict=True):
            lines.append(f"| {name} | {name_of(budget)} | {_row(budget, tally)} |")
    return "\n".join(lines)


def _row(budget: float | None, tally: Tally) -> str:
    def share(count: int) -> str:
        return f"{count} ({count / tally.judged:.0%})" if tally.judged else "–"

    cells = [
        str(tally.plans),
        str(tally.judged),
        share(tally.met),
        share(tally.warned),
        str(tally.silent),
        *(
            "–" if n is None or budget is None else str(n)
            for n in (tally.false_cannot, tally.inversions)
        ),
        "–" if tally.worst is None else f"{tally.worst:+.1f} dB",
        "–" if tally.median is None else f"{tally.median:.2f}",
        "–" if tally.maximum is None else f"{tally.maximum:.2f}",
    ]
    return " | ".join(cells)


def scenes(rows: Iterable[str]) -> str:
    """The table of rows of `scene`."""
    heads = [name_of(budget) for budget in BUDGETS]
    lines = [
        f"| scene | {' | '.join(heads)} | whole render | overspending | best plain setting |",
        f"|---|{'---|' * len(heads)}---|---|---|",
    ]
    return "\n".join([*lines, *rows])


def scene(audit: Audit) -> str:
    """A row: stated and real error at every budget, and what it costs."""
    cells = [_cell(plan) for plan in audit.plans]
    spent = [audit.overspending(plan) for plan in audit.plans]
    worst = max((ratio for ratio in spent if ratio is not None), default=None)
    complete = max((p.render_error for p in audit.plans[-1:] if not p.refused), default=None)
    best = min(audit.plain, key=lambda one: one.real, default=None)
    cells += [
        "–" if complete is None else f"{complete:.0f}",
        "–" if worst is None else f"{worst:.2f}",
        "–" if best is None else f"{best.method} ×{best.times}: {best.real:.0f}",
    ]
    return f"| {audit.name} | {' | '.join(cells)} |"


def _cell(plan: Plan) -> str:
    if plan.refused:
        return f"refused ({plan.refused.split(':')[0].removesuffix('Error').lower()})"
    words = [
        ("chaos", plan.chaotic),
        ("unsure", not plan.chaotic and not plan.is_judged),
        ("**silent**", plan.is_silent_miss),
        ("cannot", plan.warned and not plan.chaotic),
    ]
    text = " ".join(word for word, holds in words if holds)
    stated = "exact" if plan.stated <= -150.0 else f"{plan.stated:.0f}"
    if plan.stated == inf:
        stated = "not measured"
    return f"{stated} / {plan.real:.0f} {text}".strip()
