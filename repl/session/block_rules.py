"""Rules that run blocks automatically, and their fields in a journal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from ergon.notation.tables.shapes import MAX_NAME, NAME
from ergon.notation.text.errors import TextError
from ergon.repl.language.triggers import Trigger, parse_trigger
from ergon.repl.session.journal import BEAT_MAX

if TYPE_CHECKING:
    from ergon.repl.session.journal import JournalEvent

MAX_RULES = 16


class Rule(NamedTuple):
    """A rule of a block: its trigger, and the beat on which it took effect."""

    begin_beat: float
    trigger: Trigger


def rules_field(rules: Mapping[str, Rule]) -> dict[str, object]:
    """The journal field for rules; empty if there are none."""
    rule_rows = [[name, rule.begin_beat, rule.trigger.text] for name, rule in rules.items()]
    return {"rules": rule_rows} if rule_rows else {}


def read_rules(journal_event: JournalEvent) -> Mapping[str, Rule]:
    """The rules in a journal's event. Raises JournalError."""
    rule_rows: list[object] = journal_event.get("rules", list, [])
    if len(rule_rows) > MAX_RULES:
        journal_event.refuse("it has more rules than a session can have")
    return dict(_read_row(journal_event, row) for row in rule_rows)


def _read_row(journal_event: JournalEvent, row: object) -> tuple[str, Rule]:
    match row:
        case [str(block_name), float(begin_beat), str(rule_text)] if (
            NAME.fullmatch(block_name)
            and len(block_name) <= MAX_NAME
            and 0.0 <= begin_beat <= BEAT_MAX
        ):
            try:
                return block_name, Rule(begin_beat, parse_trigger(rule_text))
            except TextError as error:
                journal_event.refuse(f"the field 'rules' has the wrong value: {error.message}")
    journal_event.refuse("the field 'rules' has the wrong type or value")
