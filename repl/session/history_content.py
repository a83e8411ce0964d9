"""The history of a session as a field of a journal: each version as its difference from the last.

A resumed session writes it once, so that its journal can render an `undo` to a version from
before it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ergon.notation.tables.shapes import NAME
from ergon.repl.session.block_rules import read_rules, rules_field
from ergon.repl.session.history import PastVersions
from ergon.repl.session.journal import JournalEvent
from ergon.repl.session.journal_names import journal_name
from ergon.repl.session.midi_maps import maps_field, read_maps
from ergon.repl.session.past_versions import difference
from ergon.repl.session.strike_levels import levels_fields, read_levels
from ergon.repl.session.version import Faders, PastVersion
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.sounding import SoundingNames

_VERSIONS_MAX = 1000  # the latest are kept
_CHARACTERS_MAX = 1 << 28  # characters of all texts of a history

# Read the texts of a journal's event, and its faders.
ReadTexts = Callable[[JournalEvent], Texts]
ReadFaders = Callable[[JournalEvent], Faders]


def faders_fields(faders: Faders) -> dict[str, object]:
    """The journal fields for faders."""
    return {
        "gains": dict(faders.gains),
        "muted": sorted(faders.muted),
        "solo": sorted(faders.solo),
        "master": faders.master,
    }


def sounding_field(sounding_names: SoundingNames) -> dict[str, object]:
    """The journal field for keys and instruments that sound under other names; empty if there are
    none.
    """
    return {"sounds_as": dict(sounding_names.names)} if sounding_names.names else {}


def read_sounding(journal_event: JournalEvent) -> SoundingNames:
    """The names under which keys and instruments sound, in a journal's event. Raises
    JournalError.
    """
    if "sounds_as" not in journal_event.fields:
        return SoundingNames()
    sounding_name_by_name = journal_event.mapping("sounds_as", str)
    if not all(NAME.fullmatch(name) for pair in sounding_name_by_name.items() for name in pair):
        journal_event.refuse("the field 'sounds_as' has the wrong value")
    return SoundingNames(sounding_name_by_name)


def history_fields(history: PastVersions) -> dict[str, object]:
    """The journal fields for a history; empty if it has only its beginning."""
    first_index = max(0, history.index + 1 - _VERSIONS_MAX)
    versions = history.versions[first_index:]
    if len(versions) < 2:
        return {}
    history_rows, old_texts_by_file = [], dict[str, str]()
    for version in versions:
        texts_by_file = _texts_by_file(version.texts)
        differences = {
            name: _text_difference(old_texts_by_file.get(name, ""), text)
            for name, text in texts_by_file.items()
        }
        history_rows.append(
            {
                "number": version.number,
                "line": version.line,
                "where": version.beat_text,
                "score": version.texts.path,
                "files": {name: delta for name, delta in differences.items() if delta is not None},
                "gone": sorted(old_texts_by_file.keys() - texts_by_file.keys()),
                **faders_fields(version.faders),
                **maps_field(version.maps),
                **rules_field(version.rules),
                **sounding_field(version.sounds_as),
                **levels_fields(version.strike_levels),
            }
        )
        old_texts_by_file = texts_by_file
    return {"history": history_rows, "index": history.index - first_index}


def read_history(
    journal_event: JournalEvent, read_texts: ReadTexts, read_faders: ReadFaders
) -> PastVersions | None:
    """The history in a journal's event; None where it has none. Raises JournalError."""
    if "history" not in journal_event.fields:
        return None
    history_rows: list[Any] = journal_event.get("history", list)
    history_index = journal_event.number_of("index", int, 0, len(history_rows) - 1)
    texts_by_file: dict[str, str] = {}
    text_budget, versions = _CHARACTERS_MAX, []
    for version_fields in history_rows:
        if not isinstance(version_fields, dict):
            journal_event.refuse("the field 'history' has the wrong type or value")
        row_event = JournalEvent(
            journal_event.file, journal_event.number, "history", version_fields
        )
        removed_names = row_event.name_set("gone")
        texts_by_file = {
            name: text for name, text in texts_by_file.items() if name not in removed_names
        }
        for name, delta in row_event.get("files", dict).items():
            texts_by_file[name] = _apply_delta(row_event, texts_by_file.get(name, ""), delta)
        text_budget -= sum(map(len, texts_by_file.values()))
        if text_budget < 0:
            journal_event.refuse("its history is longer than that of a session can be")
        event_fields = {
            "score": row_event.get("score", str),
            "text": texts_by_file.get("", ""),
            "overlay": _without_score(texts_by_file),
        }
        version_texts = read_texts(
            JournalEvent(journal_event.file, journal_event.number, "history", event_fields)
        )
        versions.append(
            PastVersion(
                row_event.number_of("number", int, -len(history_rows) - 1, 0),
                row_event.get("line", str, ""),
                version_texts,
                read_faders(row_event),
                {},
                row_event.get("where", str, ""),
                maps=read_maps(row_event),
                rules=read_rules(row_event),
                sounds_as=read_sounding(row_event),
                strike_levels=read_levels(row_event),
            )
        )
    if len({version.number for version in versions}) < len(versions):
        journal_event.refuse("two versions of its history have one number")
    return PastVersions(versions, history_index)


def _texts_by_file(score_texts: Texts) -> dict[str, str]:
    """The texts by the names of their files in the journal; the name of the score is ''."""
    folder = Path(score_texts.path).parent
    score_texts = score_texts if score_texts.sealed else score_texts.complete()
    return {
        "": score_texts.text,
        **{journal_name(file, folder): text for file, text in score_texts.overlay.items()},
    }


def _without_score(files: Mapping[str, str]) -> dict[str, str]:
    return {name: text for name, text in files.items() if name}


def _text_difference(old_text: str, new_text: str) -> list[object] | None:
    """[characters kept in front, characters kept at the end, new text between]; None if equal."""
    if old_text == new_text:
        return None
    n_front, end_index, new_characters = difference(old_text, new_text)
    return [n_front, len(old_text) - end_index, new_characters]


def _apply_delta(row_event: JournalEvent, old_text: str, delta: object) -> str:
    match delta:
        case [int(n_front), int(n_behind), str(inserted_text)] if (
            n_front >= 0 and n_behind >= 0 and n_front + n_behind <= len(old_text)
        ):
            return old_text[:n_front] + inserted_text + old_text[len(old_text) - n_behind :]
    row_event.refuse("the field 'history' has the wrong type or value")
