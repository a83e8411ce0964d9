"""How many voices of each instrument that ships one core plays in real time, beside physical models
of Csound and Faust of the same kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benches import report, voice_page
from benches.measure import Row
from benches.peers import Missing
from benches.peers.voices import PROGRAMS
from benches.voice_cost import Voices, in_turns
from benches.voice_kinds import kinds
from benches.voice_page import Line
from benches.voice_plans import plan
from benches.voice_scores import instruments

ROUNDS = 5


def voices(names: Sequence[str] = (), page: bool = False) -> list[Row]:
    """Voices of some instruments, or of all; prints their table, and writes the page if asked."""
    wanted = [each for each in instruments() if not names or each.name in names]
    if unknown := sorted(set(names) - {each.name for each in wanted}):
        raise SystemExit(f"no instrument {', '.join(unknown)} says how it is played")
    machine = report.machine()
    plans = {}
    for instrument in wanted:
        plans[instrument.name] = plan(instrument)
        print(f"{instrument.name} planned", flush=True)
    references = {each.name: kinds(each, plans[each.name].oscillators) for each in wanted}
    others, missing = peers(list(references.values()))
    players = {name: planned.player for name, planned in plans.items()}
    sides = {name: player.voices for name, player in players.items()}
    counts = in_turns(ROUNDS, sides | others)
    lines = [
        Line(
            each.file,
            each.name,
            plans[each.name].modules,
            plans[each.name].method,
            counts[each.name],
            counts[each.name] * players[each.name].evenness(),
            references[each.name],
        )
        for each in wanted
    ]
    text = voice_page.table(lines, counts, missing)
    print(text, flush=True)
    if page:
        voice_page.write(text, machine, ROUNDS)
    return [row for line in lines for row in rows(line, counts, missing)]


def peers(
    references: Sequence[Mapping[str, Sequence[str]]],
) -> tuple[dict[str, Voices], dict[str, str]]:
    """The models of other programs, each once; and why those that cannot play cannot."""
    sides: dict[str, Voices] = {}
    missing: dict[str, str] = {}
    for models in references:
        for program, names in models.items():
            for name in names:
                if name not in sides and name not in missing:
                    try:
                        sides[name] = PROGRAMS[program](name)
                    except Missing as why:
                        missing[name] = str(why)
    return sides, missing


def rows(line: Line, counts: Mapping[str, float], missing: Mapping[str, str]) -> list[Row]:
    """A row for each model of the instrument's kind."""
    scene, ours = f"voices of {line.name}", f"{voice_page.number(line.voices)} on one core"
    values = {"modules": line.modules, "voices": line.voices, "busiest": line.busiest}
    result = []
    for program, models in line.references.items():
        for model in models:
            if model in missing:
                result.append(Row(scene, ours, f"{program}: {missing[model]}", None, "", values))
                continue
            theirs = f"{program} `{model}`: {voice_page.number(counts[model])}"
            ratio = line.voices / counts[model]
            result.append(Row(scene, ours, theirs, ratio, "voices over the reference's", values))
    return result or [Row(scene, ours, "no model of the kind", None, "", values)]
