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

_VERSIONS = 1000  # the latest are kept
_CHARACTERS = 1 << 28  # of all texts of a history together

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


def sounding_field(names: SoundingNames) -> dict[str, object]:
    """The journal field for keys and instruments that sound under other names; empty if there are
    none.
    """
    return {"sounds_as": dict(names.names)} if names.names else {}


def read_sounding(event: JournalEvent) -> SoundingNames:
    """The names under which keys and instruments sound, in a journal's event. Raises
    JournalError.
    """
    if "sounds_as" not in event.fields:
        return SoundingNames()
    names_by_sound = event.mapping("sounds_as", str)
    if not all(NAME.fullmatch(name) for pair in names_by_sound.items() for name in pair):
        event.refuse("the field 'sounds_as' has the wrong value")
    return SoundingNames(names_by_sound)


def history_fields(history: PastVersions) -> dict[str, object]:
    """The journal fields for a history; empty if it has only its beginning."""
    first = max(0, history.index + 1 - _VERSIONS)
    versions = history.versions[first:]
    if len(versions) < 2:
        return {}
    rows, before = [], dict[str, str]()
    for version in versions:
        files = _files(version.texts)
        changed = {name: _delta(before.get(name, ""), text) for name, text in files.items()}
        rows.append(
            {
                "number": version.number,
                "line": version.line,
                "where": version.where,
                "score": version.texts.path,
                "files": {name: delta for name, delta in changed.items() if delta is not None},
                "gone": sorted(before.keys() - files.keys()),
                **faders_fields(version.faders),
                **maps_field(version.maps),
                **rules_field(version.rules),
                **sounding_field(version.sounds_as),
                **levels_fields(version.strike_levels),
            }
        )
        before = files
    return {"history": rows, "index": history.index - first}


def read_history(event: JournalEvent, texts: ReadTexts, faders: ReadFaders) -> PastVersions | None:
    """The history in a journal's event; None where it has none. Raises JournalError."""
    if "history" not in event.fields:
        return None
    rows: list[Any] = event.get("history", list)
    index = event.number_of("index", int, 0, len(rows) - 1)
    files: dict[str, str] = {}
    left, versions = _CHARACTERS, []
    for fields in rows:
        if not isinstance(fields, dict):
            event.refuse("the field 'history' has the wrong type or value")
        row = JournalEvent(event.file, event.number, "history", fields)
        gone = row.name_set("gone")
        files = {name: text for name, text in files.items() if name not in gone}
        for name, delta in row.get("files", dict).items():
            files[name] = _apply_delta(row, files.get(name, ""), delta)
        left -= sum(map(len, files.values()))
        if left < 0:
            event.refuse("its history is longer than that of a session can be")
        named = {"score": row.get("score", str), "text": files.get("", ""), "overlay": _used(files)}
        read = texts(JournalEvent(event.file, event.number, "history", named))
        versions.append(
            PastVersion(
                row.number_of("number", int, -len(rows) - 1, 0),
                row.get("line", str, ""),
                read,
                faders(row),
                {},
                row.get("where", str, ""),
                maps=read_maps(row),
                rules=read_rules(row),
                sounds_as=read_sounding(row),
                strike_levels=read_levels(row),
            )
        )
    if len({version.number for version in versions}) < len(versions):
        event.refuse("two versions of its history have one number")
    return PastVersions(versions, index)


def _files(texts: Texts) -> dict[str, str]:
    """The texts by the names of their files in the journal; the name of the score is ''."""
    folder = Path(texts.path).parent
    texts = texts if texts.sealed else texts.complete()
    return {
        "": texts.text,
        **{journal_name(file, folder): text for file, text in texts.overlay.items()},
    }


def _used(files: Mapping[str, str]) -> dict[str, str]:
    return {name: text for name, text in files.items() if name}


def _delta(before: str, text: str) -> list[object] | None:
    """[characters kept in front, characters kept at the end, new text between]; None if equal."""
    if before == text:
        return None
    start, end, new = difference(before, text)
    return [start, len(before) - end, new]


def _apply_delta(row: JournalEvent, before: str, delta: object) -> str:
    match delta:
        case [int(front), int(behind), str(text)] if (
            front >= 0 and behind >= 0 and front + behind <= len(before)
        ):
            return before[:front] + text + before[len(before) - behind :]
    row.refuse("the field 'history' has the wrong type or value")
