"""Audits of many scenes as tables of a page."""

from collections.abc import Callable, Iterable, Sequence

from accuracy.audit import BUDGETS, Audit, Plan

Judged = tuple[Audit, Plan]


def name_of(budget: float | None) -> str:
    return "by ear" if budget is None else f"{budget:g} dB"


def summary(groups: dict[str, Sequence[Audit]]) -> str:
    """A row for each group of scenes and budget, and for all of them."""
    lines = [
        "| scenes | budget | plans | judged | met | says it cannot | silent misses "
        "| real − stated, worst | overspending: median | worst |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    everything = {"all": [audit for audits in groups.values() for audit in audits]}
    for name, audits in (*groups.items(), *everything.items()):
        for i, budget in enumerate(BUDGETS):
            pairs = [(audit, audit.plans[i]) for audit in audits]
            lines.append(f"| {name} | {name_of(budget)} | {_row(pairs)} |")
    return "\n".join(lines)


def _row(pairs: Sequence[Judged]) -> str:
    judged = [(audit, plan) for audit, plan in pairs if plan.is_judged]

    def share(holds: Callable[[Plan], bool]) -> str:
        count = sum(holds(plan) for _, plan in judged)
        return f"{count} ({count / len(judged):.0%})" if judged else "–"

    spent = [audit.overspending(plan) for audit, plan in judged]
    ratios = sorted(ratio for ratio in spent if ratio is not None)
    cells = [
        str(len(pairs)),
        str(len(judged)),
        share(lambda plan: plan.is_met) if pairs[0][1].budget is not None else "–",
        share(lambda plan: plan.warned),
        str(sum(plan.is_silent_miss for _, plan in judged)),
        f"{max(plan.excess for _, plan in judged):+.1f} dB" if judged else "–",
        f"{ratios[len(ratios) // 2]:.2f}" if ratios else "–",
        f"{ratios[-1]:.2f}" if ratios else "–",
    ]
    return " | ".join(cells)


def scenes(audits: Iterable[Audit]) -> str:
    """A row for each scene: stated and real error at every budget, and what it costs."""
    heads = [name_of(budget) for budget in BUDGETS]
    lines = [
        f"| scene | {' | '.join(heads)} | whole render | overspending | best plain setting |",
        f"|---|{'---|' * len(heads)}---|---|---|",
    ]
    for audit in audits:
        cells = [_cell(plan) for plan in audit.plans]
        spent = [audit.overspending(plan) for plan in audit.plans]
        worst = max((ratio for ratio in spent if ratio is not None), default=None)
        whole = max((p.whole for p in audit.plans[-1:] if not p.refused), default=None)
        best = min(audit.plain, key=lambda one: one.real, default=None)
        cells += [
            "–" if whole is None else f"{whole:.0f}",
            "–" if worst is None else f"{worst:.2f}",
            "–" if best is None else f"{best.method} ×{best.times}: {best.real:.0f}",
        ]
        lines.append(f"| {audit.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(plan: Plan) -> str:
    if plan.refused:
        return f"refused ({plan.refused.split(':')[0].removesuffix('Error').lower()})"
    words = [
        ("chaos", plan.chaotic),
        ("unsure", not plan.chaotic and not plan.is_judged),
        ("**silent**", plan.is_silent_miss),
        ("cannot", plan.warned and not plan.chaotic),
    ]
    said = " ".join(word for word, holds in words if holds)
    stated = "exact" if plan.stated <= -150.0 else f"{plan.stated:.0f}"
    return f"{stated} / {plan.real:.0f} {said}".strip()
