"""Names across files: `use:` brings them in, `like:` and `from:` start from another's values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, TypeVar

from ergon.instruments.model import Instrument
from ergon.instruments.transpose import transposed_base
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
from ergon.scores.reading.include import OVERRIDDEN_SECTIONS, Include, includes, transposed_values
from ergon.scores.reading.midi_uses import MidiUses
from ergon.scores.reading.overlay import overlay_fields
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Gesture, Key, TakeFile
from ergon.scores.reading.sections import SCORE_RECORD
from ergon.scores.reading.tuned import tuning_of, tunings_of

# Sections whose names other files may use.
SECTIONS = ("keys", "instruments", "gestures", "phrases", "takes", "laws")
# Sections of events: `use:` does not bring them in.
PLAYED_SECTIONS = ("strikes", "automation", "duet", "parts")
USE_DEPTH_MAX = 20  # files deep
MAX_NAMES = 20_000  # names that other files add to one
LIKE_CHAIN_MAX = 32  # things that begin with another
NOUN_BY_SECTION = dict(
    zip(SECTIONS, ("key", "instrument", "gesture", "phrase", "take", "law"), strict=True)
)
_Named = TypeVar("_Named", Gesture, TakeFile, Key | Instrument)


@dataclass(slots=True)
class Entry:
    """A named thing as written, the names that it may use, and their prefix in the file that uses
    it.
    """

    values: Any  # Values or a finished object, or MISSING
    names: Names
    prefix: str = ""
    brought_place: Place | None = None  # the `use:` that brought it

    @property
    def place(self) -> Place | None:
        """Where it is written; for a finished object, where it is brought in."""
        return self.values.place if isinstance(self.values, Values) else self.brought_place


@dataclass(slots=True)
class Names:
    """The names of one file: its own, and those that its `use:` brings in."""

    document: Document
    score: Values | None = None
    tables: dict[str, dict[str, Entry]] = field(
        default_factory=lambda: {section: {} for section in SECTIONS}
    )
    used_names: dict[str, Names] = field(
        default_factory=dict
    )  # by file stem and by prefix, for `from:`
    tuning: Tuning | None = None  # tuning of the notes in its file
    tunings: Mapping[str, Tuning] = field(
        default_factory=dict
    )  # tunings of instruments that have one
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
        self._names_by_file: dict[str, Names] = {}
        self.is_full = False  # files bring more names than are read
        self.midi_uses = MidiUses(files)
        self.pieces: dict[str, Piece] = {}  # included scores by file
        self._open_files: list[tuple[str, Place | None]] = []

    def read(self, document: Document, asked_place: Place | None = None) -> Names:
        """Names of a document; a file that is used twice is read once."""
        if document.file in self._names_by_file:
            return self._names_by_file[document.file]
        document_names = self._names_by_file[document.file] = Names(document)
        if document.root is None:
            return document_names
        document_names.tuning = tuning_of(document, self.files)
        document_names.tunings = tunings_of(document, self.files)
        memory = self.files.memory
        if memory is not None:
            all_tunings = (
                (document_names.tuning, document_names.tunings)
                if document_names.tunings
                else document_names.tuning
            )
            memory.set_condition(document.file, all_tunings)
        context = Context(self.collector, memory=memory, tunings=document_names.tunings)
        with tuning.used(document_names.tuning):
            score = SCORE_RECORD.read(document.root, "", context)
        if score is MISSING:
            return document_names
        document_names.score = score
        for section in SECTIONS:
            for name, values in (score[section] or {}).items():
                document_names.tables[section][name] = Entry(values, document_names)
        self._open_files.append((document.file, asked_place))
        for file, place, prefix in _used_files(score):
            document_names.families.append(prefix or PurePath(file).stem)
            self._add_file(document_names, file, place, prefix)
        for include_entry in includes(score):
            file_names = self._add_file(
                document_names,
                include_entry.file,
                include_entry.place,
                include_entry.prefix,
                include_entry,
            )
            if file_names is not None:
                document_names.included.append((include_entry, file_names))
        self._open_files.pop()
        return document_names

    def _add_file(
        self,
        score_names: Names,
        file_name: str,
        written_place: Place,
        prefix: str,
        include: Include | None = None,
    ) -> Names | None:
        """Bring in the names of a file, and return them; None if an error was reported."""
        if len(self._open_files) > USE_DEPTH_MAX:
            message = f"`use:` is nested more than {USE_DEPTH_MAX} files deep"
            self.collector.error("E105", message, written_place)
            return None
        document = self.files.required(
            file_name, score_names.document.folder, written_place, may_be_empty=True
        )
        if document is None:
            self.collector.lacks_names = True
            return None
        open_files = [name for name, _ in self._open_files]
        if document.file in open_files:
            file_circle = self._open_files[open_files.index(document.file) + 1 :]
            steps = [str(asking_place) for _, asking_place in file_circle if asking_place] + [
                str(written_place)
            ]
            message = f"{document.file} uses itself: {' -> '.join(steps)}"
            self.collector.error("E302", message, written_place)
            return None
        is_new = document.file not in self._names_by_file
        used_names = self.read(document, written_place)
        if is_new and used_names.score is not None:
            self._report_unplayed(
                used_names.score, document.file, written_place, is_played=include is not None
            )
        n_names = sum(
            len(table)
            for section_table in (score_names, used_names)
            for table in section_table.tables.values()
        )
        if n_names > MAX_NAMES:
            message = f"files bring more than {MAX_NAMES:,} names, many of them more than once"
            self.collector.error("E105", message, written_place)
            self.is_full = True
            return None
        score_names.used_names[PurePath(file_name).stem] = used_names
        if prefix:
            score_names.used_names[prefix] = used_names
        for section_name, table in used_names.tables.items():
            for entry_word, named_entry in table.items():
                entry_values = named_entry.values
                if include is not None and section_name == "instruments":
                    entry_values = transposed_values(entry_values, include)
                if entry_values is not named_entry.values:
                    named_entry = replace(named_entry, values=entry_values)
                self._add_entry(
                    score_names, section_name, entry_word, named_entry, written_place, prefix
                )
        return used_names if used_names.score is not None else None

    def _report_unplayed(
        self, score: Values, file_name: str, named_place: Place, *, is_played: bool
    ) -> None:
        """Report W330 if a file has sections that are not used, for it is not played by itself."""
        unplayed_sections = [
            section
            for section in (OVERRIDDEN_SECTIONS if is_played else PLAYED_SECTIONS)
            if score[section]
        ]
        if unplayed_sections:
            message = f"left out of {file_name}: {_joined_words(unplayed_sections)}"
            help_text = (
                f"`use` brings in names of {_joined_words(SECTIONS)}; `include` brings in "
                "what is played"
            )
            if is_played:
                help_text = (
                    f"{_joined_words(OVERRIDDEN_SECTIONS)} of the score that includes it are used"
                )
            self.collector.error("W330", message, named_place, help=help_text)

    def _add_entry(
        self, names: Names, section: str, word: str, entry: Entry, place: Place, prefix: str
    ) -> None:
        full_name = f"{prefix}.{word}" if prefix else word
        full_prefix = ".".join(filter(None, (prefix, entry.prefix)))
        existing_entry = names.tables[section].get(full_name)
        if existing_entry is None:
            names.tables[section][full_name] = Entry(entry.values, entry.names, full_prefix, place)
        elif existing_entry.values is not entry.values:
            earlier_place = (
                existing_entry.values.place
                if isinstance(existing_entry.values, Values)
                else existing_entry.brought_place
            )
            message = (
                f"{NOUN_BY_SECTION[section]} {quote(full_name)} of {entry.names.document.file} "
            )
            message += f"is already defined at {earlier_place}; give the file a prefix"
            self.collector.error("E303", message, place, help="use: {c: file} brings in c.name")

    def resolved(self, section: str, entry: Entry) -> tuple[Values | None, frozenset[str]]:
        """The values with `like:` and `from:` followed, and the names that refer to the thing
        itself there.

        The values are None if an error was reported.
        """
        like_chain: list[Values] = []
        while True:
            entry_values = entry.values
            if not isinstance(entry_values, Values):
                return None, frozenset()
            if any(entry_values is seen for seen in like_chain):
                lines = [
                    f"{base_values.context.name} (line {base_values.place.line})"
                    for base_values in like_chain
                ]
                circular_names = ", which begins with ".join(
                    [*lines[1:], entry_values.context.name]
                )
                label = like_chain[0].context.label("like")
                message = f"{label}: {lines[0]} begins with the values of "
                message += (
                    f"{circular_names}: a circle, in which nothing has values; write the values of "
                )
                message += "one of them out, without `like`"
                self.collector.error("E302", message, like_chain[0].place_of("like"))
                return None, frozenset()
            like_chain.append(entry_values)
            if len(like_chain) > LIKE_CHAIN_MAX:
                label = like_chain[0].context.label("like")
                message = f"{label}: the chain has more than {LIKE_CHAIN_MAX} members"
                self.collector.error("E105", message, like_chain[0].place_of("like"))
                return None, frozenset()
            if not entry_values.written("like", "from"):
                break
            base_entry = self._base_entry(section, entry_values, entry.names)
            if base_entry is None:
                return None, frozenset()
            entry = base_entry
        return self._merged_values(section, like_chain), frozenset(
            values.context.name for values in like_chain
        )

    def tuning_of(self, entry: Entry) -> Tuning | None:
        """The tuning of an instrument whose names are resolved: that which it has itself or by
        `like`, else that of the instrument that brings its notes; None if they have none.
        """
        for _ in range(
            LIKE_CHAIN_MAX if any(names.tunings for names in self._names_by_file.values()) else 0
        ):
            entry_values = entry.values
            if not isinstance(entry_values, Values):
                return None
            tuning = self._names_by_file[entry_values.node.document.file].tunings.get(
                entry_values.context.name
            )
            if (
                tuning is not None
                or not entry_values.written("like", "from")
                or entry_values.written("notes")
            ):
                return tuning
            base_entry = self._base_entry("instruments", entry_values, entry.names)
            if base_entry is None:
                return None
            entry = base_entry
        return None

    def _merged_values(self, section: str, like_chain: Sequence[Values]) -> Values:
        """The last values of a chain, with those of the others over them; the same object as in the
        reading before if none of them has changed.
        """
        memory = self.files.memory
        entry_values = like_chain[0]
        memory_key = (
            f"merged {section} {entry_values.context.name} {entry_values.node.document.file}"
        )
        old_values: Values | None = (
            None if memory is None else memory.held_for(memory_key, *like_chain)
        )
        if old_values is not None:
            return old_values
        n_reports = self.collector.n_reports
        merged_values = like_chain[-1]
        is_instrument = section == "instruments"
        if is_instrument:
            merged_values = transposed_base(merged_values, merged_values, is_root=True)
        for chain_values in reversed(like_chain[:-1]):
            if is_instrument:
                merged_values = transposed_base(merged_values, chain_values, is_root=False)
            merged_values = overlay_fields(merged_values, chain_values)
        if memory is not None and self.collector.n_reports == n_reports:
            memory.hold(memory_key, like_chain, merged_values)
        return merged_values

    def _base_entry(self, section: str, values: Values, source_names: Names) -> Entry | None:
        has_from = "from" in values.record.by_name and isinstance(values["from"], Name)
        base_name = values["like"]
        if has_from and base_name is not None:
            values.error(
                "E111",
                f"{values.context.label('from')}: `like` is written too; keep one of the two",
                "from",
            )
            return None
        if has_from:
            return self._entry_from_file(section, values["from"], values, source_names)
        if base_name is None:
            return None
        like_entry = source_names.tables[section].get(base_name)
        if like_entry is None:
            message = (
                f"{values.context.label('like')}: no {NOUN_BY_SECTION[section]} is called "
                f"{quote(base_name)}"
            )
            names = [n for n in source_names.names(section) if n != values.context.name]
            values.error("E301", message, "like", word=base_name, names=names)
        return like_entry

    def _entry_from_file(
        self, section_name: str, source_name: Name, entry_values: Values, source_names: Names
    ) -> Entry | None:
        stem, slash, name_in_file = source_name.partition("/")
        file_names = source_names.used_names.get(stem)
        if slash and file_names is None:  # the shipped instruments need no `use:`
            file_name = f"instruments/{stem}.yaml"
            is_there = self.files.find(file_name, source_names.document.folder) is not None
            folder = source_names.document.folder
            document = (
                self.files.required(file_name, folder, source_name.place) if is_there else None
            )
            file_names = self.read(document, source_name.place) if document else None
        if not slash or file_names is None or not file_names.tables[section_name]:
            message = f"{entry_values.context.label('from')}: `use:` names no file {quote(stem)}; "
            message += "write file/name, such as gong/plate"
            used_files, help_text = (
                tuple(source_names.used_names),
                _family_help(section_name, name_in_file if slash else stem),
            )
            self.collector.error(
                "E301", message, source_name.place, word=stem, names=used_files, help=help_text
            )
            return None
        file_entry = file_names.tables[section_name].get(name_in_file)
        if file_entry is None:
            message = (
                f"{entry_values.context.label('from')}: {file_names.document.file} has no "
                f"{quote(name_in_file)}"
            )
            known_names = file_names.names(section_name)
            help_text = _family_help(section_name, name_in_file)
            self.collector.error(
                "E301",
                message,
                source_name.place,
                word=name_in_file,
                names=known_names,
                help=help_text,
            )
        return file_entry


def _family_help(section: str, instrument_word: str) -> str | None:
    """Where an instrument of that name ships; None if none does."""
    if section != "instruments":
        return None
    family_names = [
        f"{family}/{instrument_word}"
        for family, members in library().items()
        if any(member.name == instrument_word for member in members)
    ]
    return f"the library has {' and '.join(family_names)}" if family_names else None


def _used_files(score: Values) -> list[tuple[str, Place, str]]:
    """(file, place, prefix) of every file that a score uses."""
    use = score["use"]
    nodes_with_prefixes: list[tuple[Any, str]] = []
    for use_entry in use if isinstance(use, tuple) else (use,):
        has_prefixes = isinstance(use_entry, dict)
        nodes_with_prefixes += (
            [(node, prefix) for prefix, node in use_entry.items()]
            if has_prefixes
            else [(use_entry, "")]
        )
    used_files = []
    for use_node, prefix in nodes_with_prefixes:
        if isinstance(use_node, Scalar):
            file = PATH.read(use_node, "use", score.context)
            if file is not MISSING:
                used_files.append((file, use_node.place, prefix))
    return used_files


def _joined_words(words: Sequence[str]) -> str:
    """`a, b and c`."""
    quoted = [f"`{word}`" for word in words]
    return " and ".join(filter(None, (", ".join(quoted[:-1]), quoted[-1])))


def with_name(named_object: _Named, name: str) -> _Named:
    """The thing with the name that this score gives it."""
    return named_object if named_object.name == name else replace(named_object, name=name)
