"""`ergon plan`: how each part is computed, at what cost and error, and what is left out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ergon.api.options import AccuracyOptions
from ergon.api.plan import Plan
from ergon.api.plan import plan as make_plan

from . import options
from .console import Console, plural
from .outcome import Refused, check_stdout
from .tables import table

if TYPE_CHECKING:
    from ergon._core import PlanRow
    from ergon.api.work_shares import Shares

_METHOD_TEXTS = {
    "stepped": "module by module, CA",
    "oscillators": "each by its own poles",
    "modes": "by modes",
    "complex modes": "by complex modes",
    "ca2p": "CA in two passes",
    "bm4": "splitting of order 4",
    "ieq": "quadratised energy",
    "e4": "exact flow (E4)",
    "unheard": "nothing: no output hears it",
    "still": "nothing: nothing moves it",
}
_LOADS_SHOWN_MAX, _PARTS_SHOWN_MAX = 8, 4  # largest numbers of loads and of parts that are listed
_BY_EAR_COLUMN = "pitch, T60, third octaves, strokes"
_COLUMN_NAMES = (
    "part",
    "modules",
    "computed",
    "error",
    _BY_EAR_COLUMN,
    "cost",
    "stable",
    "left out",
)


@click.command()
@options.score
@options.target("Also write the plan to this file, for `ergon render --plan`; - is stdout.")
@click.option(
    "--why",
    metavar="MODULE",
    help="Explain the plan of one part or module, such as bell or gong.12.",
)
@options.on
@options.from_dataclass(AccuracyOptions, "method error cents plan seed")
@options.force
@options.trust
@options.with_console
def plan(
    console: Console,
    score_path: str,
    output: str | None,
    why: str | None,
    on: str | None,
    force: bool,
    **arguments: Any,
) -> None:
    """Say how each part is computed, at what cost and error, and what is left out.

    A plan is a function of the score and of how exact it is to be, the same on every machine: costs
    are counted by a table that ships with ergon, 1.0 being one core at real time.
    """
    check_stdout(output, is_json=console.json)
    from ergon.exchange import machine_speed

    accuracy_plan = make_plan(score_path, AccuracyOptions(**arguments), report=console)
    worker_shares = None
    if on is not None:
        from ergon.api.cluster import count_of

        worker_shares = accuracy_plan.shares(count_of(on, console))
    part_rows, seen_rows = list(accuracy_plan.rows), list(accuracy_plan.seen)
    if why is not None:
        part_rows, seen_rows = _rows_of([*part_rows, *seen_rows], why), []
    if output is not None:
        accuracy_plan.write(output, force=force)
    if console.json:
        for plan_row in part_rows:
            console.record(
                "plan_row", **_fields(plan_row), only_seen=plan_row in accuracy_plan.seen
            )
        for plan_row in seen_rows:
            console.record("plan_row", **_fields(plan_row), only_seen=True)
        correction = machine_speed.read_correction()
        console.record(
            "plan",
            hash=accuracy_plan.hash,
            cost=accuracy_plan.cost,
            cost_here=None if correction is None else correction * accuracy_plan.cost,
            plan_s=accuracy_plan.seconds,
            cut_short=accuracy_plan.is_cut_short,
            kept=accuracy_plan.is_kept,
            highest_modes=dict(accuracy_plan.highest_modes),
        )
        if worker_shares is not None:
            costliest_piece = worker_shares.costliest_piece
            console.record(
                "shares",
                workers=list(worker_shares.loads),
                home=worker_shares.home_load,
                longest=worker_shares.largest_load,
                bound=worker_shares.speedup_max,
                dearest=None if costliest_piece is None else list(costliest_piece.parts),
                dearest_cost=None if costliest_piece is None else costliest_piece.cost,
            )
    elif why is not None:
        console.data(
            "".join(f"{sentence}\n" for row in part_rows for sentence in _why_sentences(row))
        )
    elif output != "-":
        shares_text = "" if worker_shares is None else _shares_text(worker_shares)
        console.data(
            _table_text(part_rows)
            + _seen_text(seen_rows)
            + _highest_modes_text(accuracy_plan)
            + _summary_text(accuracy_plan)
            + shares_text
        )


def _shares_text(worker_shares: Shares) -> str:
    """The loads of the processes, and what bounds the time."""
    if worker_shares.costliest_piece is None:
        return "nothing to share: banks, and what costs less than its sound, are computed here\n"
    speed_up = worker_shares.total / worker_shares.largest_load
    loads_text = f"on {plural(worker_shares.count, 'worker')}: "
    loads_text += ", ".join(f"{load:.2g}" for load in worker_shares.loads[:_LOADS_SHOWN_MAX])
    loads_text += (
        f"{', …' if worker_shares.count > _LOADS_SHOWN_MAX else ''}; here "
        f"{worker_shares.home_load:.2g}, and the mix; "
    )
    loads_text += f"{speed_up:.1f} times as fast as one, "
    if worker_shares.home_load > worker_shares.costliest_piece.cost:
        return (
            f"{loads_text}never more than {worker_shares.speedup_max:.1f} times: the rest is "
            "computed here\n"
        )
    part_names = " + ".join(worker_shares.costliest_piece.parts[:_PARTS_SHOWN_MAX])
    ellipsis = ", …" if len(worker_shares.costliest_piece.parts) > _PARTS_SHOWN_MAX else ""
    loads_text += (
        f"never more than {worker_shares.speedup_max:.1f} times: {part_names}{ellipsis} cannot be "
        "split "
    )
    return f"{loads_text}(cost {worker_shares.costliest_piece.cost:.2g})\n"


def _rows_of(plan_rows: list[PlanRow], module: str) -> list[PlanRow]:
    """The rows of a part, or of the part of a module."""
    part_name = module.partition(".")[0]
    part_rows = [row for row in plan_rows if part_name in row.parts]
    if not part_rows:
        from ergon.notation.text.spelling import nearest

        part_names = sorted({name for row in plan_rows for name in row.parts})
        nearest_name = nearest(part_name, part_names)
        hint = (
            f"; did you mean '{nearest_name}'?"
            if nearest_name
            else f"; there are {', '.join(part_names)}"
        )
        raise Refused(f"--why: no part is called '{part_name}'{hint}")
    return part_rows


def _contact_steps(row: PlanRow) -> int:
    """The least number of steps a frame of contacts between frames: half as many by order 2."""
    return row.contact_substeps * row.contact_order // 4


def _fields(plan_row: PlanRow) -> dict[str, object]:
    return {
        "parts": plan_row.parts,
        "n_mat": plan_row.n_mat,
        "n_lia": plan_row.n_lia,
        "what": plan_row.what,
        "modes": None if plan_row.modes is None else plan_row.modes[0],
        "modes_of": None if plan_row.modes is None else plan_row.modes[1],
        "left_out_db": plan_row.left_out_db,
        "times": plan_row.oversampling,
        "in_frames": plan_row.every,
        "contact_steps": _contact_steps(plan_row),
        "contact_order": plan_row.contact_order,
        "error_db": plan_row.error_db,
        "error_over_s": plan_row.error_s,
        "spectral_db": plan_row.spectral_db,
        "cents": None if plan_row.audible is None else plan_row.audible.cents,
        "t60_percent": None if plan_row.audible is None else 100 * plan_row.audible.t60,
        "third_octave_db": None if plan_row.audible is None else plan_row.audible.third_octave_db,
        "first_stroke_s": None if plan_row.audible is None else plan_row.audible.first_stroke_s,
        "later_stroke_s": None if plan_row.audible is None else plan_row.audible.later_stroke_s,
        "stroke_db": None if plan_row.audible is None else plan_row.audible.stroke_db,
        "cost": plan_row.cost,
        "certificate": plan_row.guarantee,
        "because": plan_row.because,
        "every": plan_row.macrostep,
        "radius": plan_row.radius,
        "preserved": plan_row.preserved,
        "offered": plan_row.offered,
        "stays": plan_row.stays,
        "cut_short": plan_row.cut_short,
        "diverges": plan_row.diverges,
        "harder_at_s": plan_row.harder_at,
        "unchecked_from_s": plan_row.unchecked_from,
    }


def _table_text(rows: list[PlanRow]) -> str:
    is_heard = any(row.audible is not None for row in rows)
    columns = [
        column_index
        for column_index, heading in enumerate(_COLUMN_NAMES)
        if is_heard or heading != _BY_EAR_COLUMN
    ]
    return table(
        [line[column_index] for column_index in columns]
        for line in (_COLUMN_NAMES, *(_table_row(row) for row in rows))
    )


def _table_row(plan_row: PlanRow) -> tuple[str, ...]:
    from ergon.scores.staging.planning import needs_trial

    method_text = _METHOD_TEXTS[plan_row.what]
    if plan_row.modes is not None:
        n_used, n_total = plan_row.modes
        method_text = plural(n_used, _mode_noun(plan_row)) + (
            "" if n_used == n_total else f" of {n_total:,}"
        )
    if plan_row.macrostep is not None and plan_row.what != "e4":
        method_text += f", once in {plural(plan_row.macrostep, 'frame')}"
    if plan_row.every > 1:
        steps_text = "once" if plan_row.oversampling == 1 else f"{plan_row.oversampling} times"
        method_text += f", {steps_text} in {plural(plan_row.every, 'frame')}"
    elif plan_row.oversampling > 1:
        method_text += f" ×{plan_row.oversampling}"
    if plan_row.contact_substeps > 1:
        order_text = f" of order {plan_row.contact_order}" if plan_row.contact_order == 2 else ""
        method_text += f", contacts ×{_contact_steps(plan_row)}{order_text}"
    is_left_out = plan_row.what in ("unheard", "still")
    error_text = (
        ""
        if is_left_out
        else "exact"
        if plan_row.error_db is None
        else f"{plan_row.error_db:.0f} dB"
    )
    if needs_trial(plan_row) and plan_row.error_db is None:
        error_text = "diverges" if plan_row.diverges else "not measured"
    if plan_row.preserved:
        error_text += ", preserved"
    if plan_row.cut_short:
        error_text += ", planning ended"
    if plan_row.spectral_db is not None:
        error_text += (
            f" over {plan_row.error_s:.2g} s, then {plan_row.spectral_db:.1f} dB by spectrum"
        )
    elif plan_row.harder_at is not None:
        error_text += f" over {plan_row.error_s:.2g} s, then played harder"
    elif plan_row.unchecked_from is not None and not plan_row.preserved:
        error_text += f" over {plan_row.unchecked_from:.2g} s"
    by_ear = plan_row.audible
    audible_text = (
        ""
        if by_ear is None
        else f"{by_ear.cents:.1f} cents, {100 * by_ear.t60:.1f}%, {by_ear.third_octave_db:.1f} dB, "
        f"{1e3 * max(by_ear.first_stroke_s, by_ear.later_stroke_s):.1f} ms"
    )
    return (
        " + ".join(plan_row.parts),
        f"{plan_row.n_mat + plan_row.n_lia:,}",
        method_text,
        error_text,
        audible_text,
        "" if is_left_out else f"{plan_row.cost:.2g}",
        plan_row.guarantee or "",
        "" if plan_row.left_out_db is None else f"{plan_row.left_out_db:.0f} dB",
    )


def _seen_text(rows: list[PlanRow]) -> str:
    """The table of unheard parts that are computed to be drawn."""
    return f"\nseen, and not heard (--see all):\n{_table_text(rows)}" if rows else ""


def _highest_modes_text(accuracy_plan: Plan) -> str:
    """The highest mode of each string and plate."""
    mode_texts = [
        f"{name} {hertz / 1e3:.3g} kHz" for name, hertz in accuracy_plan.highest_modes.items()
    ]
    return f"\nhighest modes: {', '.join(mode_texts)}\n" if mode_texts else ""


def _summary_text(accuracy_plan: Plan) -> str:
    from ergon.exchange import machine_speed

    cost, correction = accuracy_plan.cost, machine_speed.read_correction()
    speed_text = (
        f"{1 / cost:.3g} × real time on one core by the table" if cost > 0 else "nothing to do"
    )
    if correction is not None and cost > 0:
        speed_text += f", {1 / (cost * correction):.3g} × on this machine by `ergon doctor`"
    planned_text = f"planned in {accuracy_plan.seconds:.2g} s"
    if accuracy_plan.is_kept:
        planned_text += " (from the cache)"
    return (
        f"\ncost {cost:.3g}: {speed_text}; {planned_text}; plan sha256 {accuracy_plan.hash[:12]}\n"
    )


def _mode_noun(row: PlanRow) -> str:
    return "complex mode" if row.what == "complex modes" else "mode"


def _steps_text(row: PlanRow) -> str:
    times = "once" if row.oversampling == 1 else f"{row.oversampling} times"
    return f"{times} a frame" if row.every == 1 else f"{times} in {plural(row.every, 'frame')}"


def _why_sentences(row: PlanRow) -> list[str]:
    """How a part is computed, and why, in sentences."""
    name = " + ".join(row.parts)
    lines = [f"{name}: {plural(row.n_mat, 'MAT')} and {plural(row.n_lia, 'LIA')}."]
    if row.what == "oscillators":
        lines.append(
            "  Nothing ties its masses to each other: each runs exactly, by its own poles."
        )
    elif row.what == "unheard":
        lines.append("  No output listens to it, nor to anything that it can move: it is left out.")
    elif row.what == "still":
        lines.append("  Nothing ever moves it: what is heard of it is a constant.")
    elif row.modes is not None:
        n_used, n_total = row.modes
        modes_text = f"{plural(n_used, _mode_noun(row))} of {n_total:,}"
        lines.append(f"  It is linear: {modes_text} are computed, each exactly.")
        if row.left_out_db is not None:
            lines.append(
                f"  The others together would be {-row.left_out_db:.0f} dB below the rest."
            )
    elif row.macrostep is not None:
        if row.what == "e4":
            lines.append(
                "  Its springs act by their exact flow (E4), and its rate changes no sound."
            )
        else:
            often = f"once in {plural(row.macrostep, 'frame')}"
            lines.append(f"  Its springs pull {often}, by the CA scheme at that rate.")
        if row.offered:
            lines.append("  The planner chose this by itself: it costs less.")
        if row.radius is not None:
            lines.append(f"  Nothing grows from frame to frame: |λ| is at most {row.radius:.9g}.")
    elif row.what == "stepped":
        lines.append(f"  It is stepped module by module by the CA scheme, {_steps_text(row)}.")
    else:
        lines.append(
            f"  It is stepped as one mesh by {_METHOD_TEXTS[row.what]}, {_steps_text(row)}."
        )
    if row.because is not None:
        lines.append(f"  It is not computed by modes: {row.because}.")
    if row.stays is not None:
        lines.append(f"  The rate that it asks for is not used for {row.stays}.")
    if row.contact_substeps > 1:
        lines.append("  Closed contacts, and single laws, are computed between frames,")
        steps_text = plural(_contact_steps(row), "step")
        lines.append(f"  {steps_text} a frame or more, of order {row.contact_order}.")
    if row.error_db is not None and row.error_s is not None:
        pilot_span = f"over the first {row.error_s:.2g} s"
        lines.append(f"  A pilot measured an error of {row.error_db:.0f} dB {pilot_span}.")
    if row.audible is not None:
        from ergon.scores.staging.planning import error_text

        lines.append(f"  Of that {error_text(row.audible)}.")
    if row.harder_at is not None:
        lines.append(
            f"  From {row.harder_at:.3g} s on it is played harder than while that was measured."
        )
    if row.cut_short:
        lines.append("  Planning ended there: its trials had done all the work that they may.")
    if row.diverges:
        lines.append("  Its motion diverged in a trial: a render stops there.")
    if row.spectral_db is not None:
        lines.append("  After that it is chaotic: no two methods give the same waveform;")
        lines.append(f"  its third octaves are right to {row.spectral_db:.1f} dB, in the mean.")
    if row.guarantee is not None:
        lines.append(
            f"  It cannot diverge: {row.guarantee}."
            if row.guarantee == "proved"
            else f"  Stability: {row.guarantee}."
        )
        lines.append(f"  It costs {row.cost:.2g} of a core at real time.")
    return lines
