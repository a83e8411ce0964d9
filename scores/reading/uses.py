"""Names across files: `use:` brings them in, `like:` and `from:` start from another's values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, TypeVar

from ergon.instruments.model import Instrument
from ergon.instruments.transpose import base_at_pitch
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context, Name
from ergon.notation.tables.tuning import Tuning
from ergon.notation.tables.value_kinds import PATH
from ergon.notation.text.document import Document, Scalar
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.reading.families import library
from ergon.scores.reading.include import YIELDING, Include, includes, transposed
from ergon.scores.reading.midi_uses import MidiUses
from ergon.scores.reading.overlay import overlay_fields
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Gesture, Key, TakeFile
from ergon.scores.reading.sections import SCORE
from ergon.scores.reading.tuned import tuning_of, tunings_of

# Sections whose names other files may use.
SECTIONS = ("keys", "instruments", "gestures", "phrases", "takes", "laws")
# Sections of events: `use:` does not bring them in.
PLAYED = ("strikes", "automation", "duet", "parts")
MAX_USES = 20  # files deep
MAX_NAMES = 20_000  # that other files bring to one
MAX_LIKE = 32  # things that begin with another
NOUNS = dict(zip(SECTIONS, ("key", "instrument", "gesture", "phrase", "take", "law"), strict=True))
_Named = TypeVar("_Named", Gesture, TakeFile, Key | Instrument)


@dataclass(slots=True)
class Entry:
    """A named thing as written, the names that it may use, and their prefix in the file that uses
    it.
    """

    values: Any  # Values or a finished object, or MISSING
    home: Names
    prefix: str = ""
    brought: Place | None = None  # the `use:` that brought it

    @property
    def place(self) -> Place | None:
        """Where it is written; for a finished object, where it is brought in."""
        return self.values.place if isinstance(self.values, Values) else self.brought


@dataclass(slots=True)
class Names:
    """The names of one file: its own, and those that its `use:` brings in."""

    document: Document
    score: Values | None = None
    tables: dict[str, dict[str, Entry]] = field(
        default_factory=lambda: {section: {} for section in SECTIONS}
    )
    used: dict[str, Names] = field(default_factory=dict)  # by file stem and by prefix, for `from:`
    tuning: Tuning | None = None  # of the notes that its file writes
    tunings: Mapping[str, Tuning] = field(default_factory=dict)  # of its instruments with their own
    families: list[str] = field(default_factory=list)  # what `use:` names: prefixes, or file stems
    included: list[tuple[Include, Names]] = field(default_factory=list)

    def names(self, section: str) -> tuple[str, ...]:
        """All names of a section, for did-you-mean."""
        return tuple(self.tables[section])


class Uses:
    """Reads a score and all the files that it uses."""

    def __init__(self, files: Files, collector: Collector) -> None:
        """Start with no file read."""
        self.files = files
        self.collector = collector
        self._read: dict[str, Names] = {}
        self.is_full = False  # files bring more names than are read
        self.midi = MidiUses(files)
        self.pieces: dict[str, Piece] = {}  # of scores that are included, by file
        self._open: list[tuple[str, Place | None]] = []

    def read(self, document: Document, asked_place: Place | None = None) -> Names:
        """Names of a document; a file that is used twice is read once."""
        if document.file in self._read:
            return self._read[document.file]
        names = self._read[document.file] = Names(document)
        if document.root is None:
            return names
        names.tuning = tuning_of(document, self.files)
        names.tunings = tunings_of(document, self.files)
        memory = self.files.memory
        if memory is not None:
            all_tunings = (names.tuning, names.tunings) if names.tunings else names.tuning
            memory.under(document.file, all_tunings)
        context = Context(self.collector, memory=memory, tunings=names.tunings)
        with tuning.used(names.tuning):
            score = SCORE.read(document.root, "", context)
        if score is MISSING:
            return names
        names.score = score
        for section in SECTIONS:
            for name, values in (score[section] or {}).items():
                names.tables[section][name] = Entry(values, names)
        self._open.append((document.file, asked_place))
        for file, place, prefix in _files(score):
            names.families.append(prefix or PurePath(file).stem)
            self._add_file(names, file, place, prefix)
        for include_entry in includes(score):
            file_names = self._add_file(
                names, include_entry.file, include_entry.place, include_entry.prefix, include_entry
            )
            if file_names is not None:
                names.included.append((include_entry, file_names))
        self._open.pop()
        return names

    def _add_file(
        self, names: Names, file: str, place: Place, prefix: str, include: Include | None = None
    ) -> Names | None:
        """Bring in the names of a file, and return them; None if an error was reported."""
        if len(self._open) > MAX_USES:
            message = f"`use:` is nested more than {MAX_USES} files deep"
            self.collector.error("E105", message, place)
            return None
        document = self.files.required(file, names.document.folder, place, may_be_empty=True)
        if document is None:
            self.collector.lacks_names = True
            return None
        opened = [name for name, _ in self._open]
        if document.file in opened:
            chain = self._open[opened.index(document.file) + 1 :]
            steps = [str(asked) for _, asked in chain if asked] + [str(place)]
            message = f"{document.file} uses itself: {' -> '.join(steps)}"
            self.collector.error("E302", message, place)
            return None
        is_new = document.file not in self._read
        used = self.read(document, place)
        if is_new and used.score is not None:
            self._tell_unplayed(used.score, document.file, place, is_played=include is not None)
        count = sum(len(table) for own in (names, used) for table in own.tables.values())
        if count > MAX_NAMES:
            message = f"files bring more than {MAX_NAMES:,} names, many of them more than once"
            self.collector.error("E105", message, place)
            self.is_full = True
            return None
        names.used[PurePath(file).stem] = used
        if prefix:
            names.used[prefix] = used
        for section, table in used.tables.items():
            for word, entry in table.items():
                values = entry.values
                if include is not None and section == "instruments":
                    values = transposed(values, include)
                if values is not entry.values:
                    entry = replace(entry, values=values)
                self._add(names, section, word, entry, place, prefix)
        return used if used.score is not None else None

    def _tell_unplayed(self, score: Values, file: str, place: Place, *, is_played: bool) -> None:
        """Report W330 if a file has sections that are not used, for it is not played by itself."""
        unplayed = [section for section in (YIELDING if is_played else PLAYED) if score[section]]
        if unplayed:
            message = f"left out of {file}: {_and(unplayed)}"
            help = f"`use` brings in names of {_and(SECTIONS)}; `include` brings in what is played"
            if is_played:
                help = f"{_and(YIELDING)} of the score that includes it are used"
            self.collector.error("W330", message, place, help=help)

    def _add(
        self, names: Names, section: str, word: str, entry: Entry, place: Place, prefix: str
    ) -> None:
        full = f"{prefix}.{word}" if prefix else word
        seen = ".".join(filter(None, (prefix, entry.prefix)))
        existing = names.tables[section].get(full)
        if existing is None:
            names.tables[section][full] = Entry(entry.values, entry.home, seen, place)
        elif existing.values is not entry.values:
            where = (
                existing.values.place if isinstance(existing.values, Values) else existing.brought
            )
            message = f"{NOUNS[section]} {quote(full)} of {entry.home.document.file} "
            message += f"is already defined at {where}; give the file a prefix"
            self.collector.error("E303", message, place, help="use: {c: file} brings in c.name")

    def resolved(self, section: str, entry: Entry) -> tuple[Values | None, frozenset[str]]:
        """The values with `like:` and `from:` followed, and the names that refer to the thing
        itself there.

        The values are None if an error was reported.
        """
        chain: list[Values] = []
        while True:
            values = entry.values
            if not isinstance(values, Values):
                return None, frozenset()
            if any(values is seen for seen in chain):
                lines = [f"{v.context.name} (line {v.place.line})" for v in chain]
                circle = ", which begins with ".join([*lines[1:], values.context.name])
                message = f"{chain[0].context.label('like')}: {lines[0]} begins with the values of "
                message += f"{circle}: a circle, in which nothing has values; write the values of "
                message += "one of them out, without `like`"
                self.collector.error("E302", message, chain[0].place_of("like"))
                return None, frozenset()
            chain.append(values)
            if len(chain) > MAX_LIKE:
                message = (
                    f"{chain[0].context.label('like')}: the chain has more than {MAX_LIKE} members"
                )
                self.collector.error("E105", message, chain[0].place_of("like"))
                return None, frozenset()
            if not values.written("like", "from"):
                break
            base = self._base(section, values, entry.home)
            if base is None:
                return None, frozenset()
            entry = base
        return self._merged(section, chain), frozenset(values.context.name for values in chain)

    def tuning_of(self, entry: Entry) -> Tuning | None:
        """The tuning of an instrument whose names are resolved: that which it has itself or by
        `like`, else that of the instrument that brings its notes; None if they have none.
        """
        for _ in range(MAX_LIKE if any(names.tunings for names in self._read.values()) else 0):
            values = entry.values
            if not isinstance(values, Values):
                return None
            tuned = self._read[values.node.document.file].tunings.get(values.context.name)
            if tuned is not None or not values.written("like", "from") or values.written("notes"):
                return tuned
            base = self._base("instruments", values, entry.home)
            if base is None:
                return None
            entry = base
        return None

    def _merged(self, section: str, chain: Sequence[Values]) -> Values:
        """The last values of a chain, with those of the others over them; the same object as in the
        reading before if none of them has changed.
        """
        memory = self.files.memory
        name = f"merged {section} {chain[0].context.name} {chain[0].node.document.file}"
        merged_before: Values | None = None if memory is None else memory.held_for(name, *chain)
        if merged_before is not None:
            return merged_before
        n_reports = self.collector.n_reports
        result = chain[-1]
        is_instrument = section == "instruments"
        if is_instrument:
            result = base_at_pitch(result, result, is_root=True)
        for values in reversed(chain[:-1]):
            if is_instrument:
                result = base_at_pitch(result, values, is_root=False)
            result = overlay_fields(result, values)
        if memory is not None and self.collector.n_reports == n_reports:
            memory.hold(name, chain, result)
        return result

    def _base(self, section: str, values: Values, home: Names) -> Entry | None:
        has_from = "from" in values.record.by_name and isinstance(values["from"], Name)
        like = values["like"]
        if has_from and like is not None:
            values.error(
                "E111",
                f"{values.context.label('from')}: `like` is written too; keep one of the two",
                "from",
            )
            return None
        if has_from:
            return self._from_file(section, values["from"], values, home)
        if like is None:
            return None
        entry = home.tables[section].get(like)
        if entry is None:
            message = f"{values.context.label('like')}: no {NOUNS[section]} is called {quote(like)}"
            names = [n for n in home.names(section) if n != values.context.name]
            values.error("E301", message, "like", word=like, names=names)
        return entry

    def _from_file(self, section: str, name: Name, values: Values, home: Names) -> Entry | None:
        stem, slash, word = name.partition("/")
        file_names = home.used.get(stem)
        if slash and file_names is None:  # the shipped instruments need no `use:`
            file = f"instruments/{stem}.yaml"
            is_there = self.files.find(file, home.document.folder) is not None
            folder = home.document.folder
            document = self.files.required(file, folder, name.place) if is_there else None
            file_names = self.read(document, name.place) if document else None
        if not slash or file_names is None or not file_names.tables[section]:
            message = f"{values.context.label('from')}: `use:` names no file {quote(stem)}; "
            message += "write file/name, such as gong/plate"
            used, help = tuple(home.used), _family_help(section, word if slash else stem)
            self.collector.error("E301", message, name.place, word=stem, names=used, help=help)
            return None
        entry = file_names.tables[section].get(word)
        if entry is None:
            message = (
                f"{values.context.label('from')}: {file_names.document.file} has no {quote(word)}"
            )
            names = file_names.names(section)
            help = _family_help(section, word)
            self.collector.error("E301", message, name.place, word=word, names=names, help=help)
        return entry


def _family_help(section: str, word: str) -> str | None:
    """Where an instrument of that name ships; None if none does."""
    if section != "instruments":
        return None
    family_names = [
        f"{family}/{word}"
        for family, members in library().items()
        if any(member.name == word for member in members)
    ]
    return f"the library has {' and '.join(family_names)}" if family_names else None


def _files(score: Values) -> list[tuple[str, Place, str]]:
    """(file, place, prefix) of every file that a score uses."""
    use = score["use"]
    nodes_with_prefixes: list[tuple[Any, str]] = []
    for entry in use if isinstance(use, tuple) else (use,):
        has_prefixes = isinstance(entry, dict)
        nodes_with_prefixes += (
            [(node, prefix) for prefix, node in entry.items()] if has_prefixes else [(entry, "")]
        )
    files = []
    for node, prefix in nodes_with_prefixes:
        if isinstance(node, Scalar):
            file = PATH.read(node, "use", score.context)
            if file is not MISSING:
                files.append((file, node.place, prefix))
    return files


def _and(words: Sequence[str]) -> str:
    """`a, b and c`."""
    quoted = [f"`{word}`" for word in words]
    return " and ".join(filter(None, (", ".join(quoted[:-1]), quoted[-1])))


def called(named_object: _Named, name: str) -> _Named:
    """The thing with the name that this score gives it."""
    return named_object if named_object.name == name else replace(named_object, name=name)
