"""Keys and instruments of a piece, with all names in them looked up."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from ergon.instruments import modal, rules
from ergon.instruments.laws import LawText, is_name
from ergon.instruments.model import Instrument, Layout, Module
from ergon.instruments.module_kinds import member_count
from ergon.instruments.names import Family, Part, PartNames
from ergon.instruments.read import instrument
from ergon.instruments.space import mesh_file
from ergon.instruments.transpose import moved, named_pitch
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import named_amounts
from ergon.notation.tables.notes import pitch
from ergon.notation.tables.shapes import MISSING, Name
from ergon.notation.text.document import Document
from ergon.notation.text.errors import quote
from ergon.notation.text.syntax import Decoder, decode
from ergon.notation.text.values import Place
from ergon.scores.reading import build, build_mix, overlay
from ergon.scores.reading.gestures_and_takes import GesturesAndTakes
from ergon.scores.reading.known_modules import resolve_names
from ergon.scores.reading.playing import Key
from ergon.scores.reading.rates import Rates
from ergon.scores.reading.uses import Entry, Names, Uses, called

_Item = TypeVar("_Item")
_Part = TypeVar("_Part", Key, Instrument)

MAX_MATS = 4_000_000  # of all instruments: about 1 GB of state and parameters


class PartsReader:
    """The keys and instruments of a score, and those of other files that it reaches."""

    def __init__(
        self, names: Names, uses: Uses, part_names: PartNames, gestures_and_takes: GesturesAndTakes
    ) -> None:
        """Take what was read."""
        assert names.score is not None
        self._names = names
        self._uses = uses
        self._part_names = part_names
        self._gestures_and_takes = gestures_and_takes
        self._collector = uses.collector
        self._score = names.score
        self._rates = Rates(names.score)
        self._written: dict[str, tuple[Entry, Values]] = {}
        # Parts whose names are not looked up yet, whether they belong to the piece or not.
        self.by_name: dict[str, Key | Instrument] = {}
        self.keys: dict[str, Key] = {}
        self.instruments: dict[str, Instrument] = {}

    @property
    def rate(self) -> float:
        """Frames a second of the sound [Hz]."""
        return self._rates.audio

    @property
    def motion(self) -> float | None:
        """The lowest rate of parts that are only seen [Hz]; None: the audio rate."""
        return self._rates.motion

    def read(self) -> None:
        """Read all keys and instruments by name, so that modules can reach each other."""
        for section in ("keys", "instruments"):
            for name, entry in self._names.tables[section].items():
                if name in self._written:
                    message = (
                        f"{quote(name)} is the name of a key and of "
                        "an instrument; rename one of them"
                    )
                    self._collector.error("E303", message, entry.place or self._score.place)
                    continue
                values, selves = self._uses.resolved(section, entry)
                if values is None:
                    self._part_names.broken.add(name)
                    continue
                tuned = self._uses.tuning_of(entry) if section == "instruments" else None
                if tuned is not None:
                    self._part_names.tunings[name] = tuned
                with tuning.used(tuned or self._names.tuning):
                    if section == "instruments" and values.written("notes"):
                        self._notes(name, entry, values, selves)
                    else:
                        self._part(section, name, entry, values, selves)

    def _part(
        self, section: str, name: str, entry: Entry, values: Values, selves: frozenset[str]
    ) -> None:
        values = self._with_files(values)
        part_object = called(self._read_part(section, name, entry, values), name)
        struck = part_object.struck if isinstance(part_object, Key) else None
        modules = {module.name: module for module in part_object.modules}
        broken = frozenset(values["modules"] or {}).difference(modules)
        axes, acts = 1, {}
        if isinstance(part_object, Instrument):
            axes, acts = part_object.axes, {act.name: act for act in part_object.acts}
        if values.written("out") and "out" not in values.by_name:
            self._part_names.broken.add(name)
        self._part_names.parts[name] = Part(
            name, modules, struck, entry.prefix, broken, selves, axes, acts
        )
        if acts:
            label = values.context.label("ready")
            self._part_names.bring_ready(self._part_names.parts[name], values["ready"] or (), label)
        self._written[name] = entry, values
        self.by_name[name] = part_object

    def _with_files(self, values: Values) -> Values:
        """The values, completed by the content of files that BANK, MODES, MESH and BUT name."""

        def read(file: str, place: Place, decoder: Decoder = decode) -> Document | None:
            files = self._uses.files
            return files.plain(file, files.documents[place.file].folder, place, decoder)

        def filled(owner: Values) -> Values:
            body = owner.by_name.get(owner.kind)
            if not isinstance(body, Values):
                return owner
            if owner.kind in ("BANK", "MODES") and body.written("modes"):
                body_read = modal.from_file(body, read, moved, self._collector)
            elif owner.kind == "MESH" and body.written("file"):
                body_read = mesh_file.from_file(body, read, self._collector)
            elif owner.kind == "BUT" and isinstance(wall := body.by_name.get("mesh"), Values):
                wall = mesh_file.from_file(wall, read, self._collector)
                body_read = replace(body, by_name={**body.by_name, "mesh": wall})
            else:
                return owner
            return replace(owner, by_name={**owner.by_name, owner.kind: body_read})

        filled_values = filled(values)
        modules = values["modules"] or {}
        filled_modules = {
            n: filled(module) if isinstance(module, Values) else module
            for n, module in modules.items()
        }
        if any(filled_modules[n] is not module for n, module in modules.items()):
            filled_values = replace(
                filled_values, by_name={**filled_values.by_name, "modules": filled_modules}
            )
        return filled_values

    def _notes(self, name: str, entry: Entry, values: Values, selves: frozenset[str]) -> None:
        """Make an instrument for each note, with the note in its name: `string.F3`."""
        notes = values["notes"]
        if notes is None:
            self._part_names.broken.add(name)
            return
        if named_pitch(values) is None:
            reason = "its modules have no named pitch; write `f`, at which they are written"
            if values.kind == "BANK":
                reason = "a BANK has pitches of its own"
            # A field that was refused, which is reported already, may have said it.
            if not (self._collector.has_errors() and _is_refused(values)):
                values.error("E103", f"{values.context.label('notes')}: {reason}", "notes")
            self._part_names.broken.add(name)
            return
        parts = {pitch(note) or 0.0: f"{name}.{note}" for note in notes}
        family = self._part_names.families[name] = Family(parts, tuning.written())
        for word, member in (values["members"] or {}).items():
            if family.note(word) is None:
                message = f"{values.context.label('members')}: it has no note {quote(word)}"
                self._collector.error("E301", message, member.place, word=word, names=notes)
        for note in notes:
            part = f"{name}.{note}"
            pitched = self._values_at_note(part, values, note, entry.values)
            self._part("instruments", part, entry, pitched, selves | {name})

    def _values_at_note(self, part: str, values: Values, note: str, member: object) -> Values:
        """The values of an instrument, whose `member` may move all its notes, at one of them."""
        interval = member.by_name.get("transpose") if isinstance(member, Values) else None
        memory, name = self._uses.files.memory, f"note {part}"
        values_before = None if memory is None else memory.held_for(name, values)
        if values_before is not None and values_before[0] == interval:
            pitched: Values = values_before[1]
            return pitched
        n_reports = self._collector.n_reports
        pitched = overlay.shifted_note(values, note, interval)
        if memory is not None and self._collector.n_reports == n_reports:
            memory.hold(name, (values,), (interval, pitched))
        return pitched

    def _read_part(self, section: str, name: str, entry: Entry, values: Values) -> Key | Instrument:
        memory = self._uses.files.memory
        amounts_by_name = tuple(named_amounts(values.node.document).names.items())
        make: Callable[[Values], Key | Instrument] = partial(self._instrument, amounts_by_name)
        if section == "keys":
            make = partial(build.key, files=self._uses.files)
        is_file_read = section == "keys" and values["calib"] is not None
        if memory is None or is_file_read:
            return make(values)
        # The key has the name too, because one node may have several names (a YAML alias).
        key = section, values.node, values.context.name, amounts_by_name
        if values is entry.values:
            return memory.recall(key, partial(make, values))
        # Values that were merged (`like`, `from`) have the node of one of them.
        place = f"made {section} {name} {values.node.document.file}"
        part_before = memory.held(place, amounts_by_name)
        if part_before is not None and part_before[0] is values:
            return part_before[1]  # type: ignore[no-any-return]
        n_reports = self._collector.n_reports
        part = make(values)
        if self._collector.n_reports == n_reports:
            memory.hold(place, amounts_by_name, (values, part))
        return part

    def _instrument(self, amounts_key: Hashable, values: Values) -> Instrument:
        """An instrument, of which only modules that have changed are read; `amounts_key` are the
        values of `let`.
        """
        memory = self._uses.files.memory
        if memory is None:
            return instrument(values)
        place = f"read {values.context.name} {values.node.document.file}"
        modules_before: dict[Hashable, Any] = memory.held(place, amounts_key) or {}
        modules_now: dict[Hashable, Any] = {}

        def recall(key: Hashable, make: Callable[[], _Item]) -> _Item:
            n_reports = self._collector.n_reports
            value: _Item = modules_before[key] if key in modules_before else make()
            if self._collector.n_reports == n_reports:
                modules_now[key] = value
            return value

        result = instrument(values, recall)
        memory.hold(place, amounts_key, modules_now)
        return result

    def look_up(self) -> None:
        """Look up the names in all parts that belong to the piece, and in those they lead to."""
        todo = [n for n, (entry, _) in self._written.items() if entry.brought is None]
        todo += sorted(self._part_names.reached - set(todo))
        parts_done: set[str] = set()
        total = 0
        while todo:
            name = todo.pop(0)
            if name in parts_done or name not in self._written:
                continue
            parts_done.add(name)
            _, values = self._written[name]
            part_built = self.by_name[name]
            part = self._part_names.parts[name]
            takes = self._names.tables["takes"]
            modules = self._resolved(part, takes)
            n_mats, sources = self._contents(name, modules)
            total += n_mats
            for source in sources:
                if source in takes:
                    self._gestures_and_takes.take(source, takes[source])
            if isinstance(part_built, Key):
                self._struck(part_built)
                step_frames = self._rates.key_step_frames(values)
                self.keys[name] = self._same(
                    replace(part_built, modules=modules, every=step_frames)
                )
            else:
                acts = tuple(self._part_names.resolved_act(part, a) for a in part.acts.values())
                outputs = rules.outputs(part, part_built.outputs, self._part_names, self._layout)
                step_frames = self._rates.instrument_step_frames(values)
                self.instruments[name] = self._same(
                    replace(
                        part_built, modules=modules, outputs=outputs, every=step_frames, acts=acts
                    )
                )
            todo += sorted(self._part_names.reached - parts_done)
            if total > MAX_MATS:
                message = f"the piece has more than {MAX_MATS:,} masses"
                self._collector.error("E105", message, part_built.place)
                break
        order = list(self._written)
        self.keys = {n: self.keys[n] for n in order if n in self.keys}
        self.instruments = {n: self.instruments[n] for n in order if n in self.instruments}

    def _contents(self, name: str, modules: tuple[Module, ...]) -> tuple[int, tuple[str, ...]]:
        """The number of masses of modules, and the takes that they name."""
        memory = self._uses.files.memory
        contents_before = None if memory is None else memory.held_for(f"contents {name}", modules)
        if contents_before is None:
            n_mats = sum(member_count(m.kind, m.fields) * m.fields.get("axes", 1) for m in modules)
            sources = (module.fields.get("from") for module in modules)
            contents_before = (
                n_mats,
                tuple([source for source in sources if isinstance(source, Name)]),
            )
            if memory is not None:
                memory.hold(f"contents {name}", (modules,), contents_before)
        return contents_before

    def _same(self, part: _Part) -> _Part:
        """The part of the reading before, if it has the same modules and is equal."""
        memory = self._uses.files.memory
        if memory is None:
            return part
        part_before: _Part | None = memory.held_for(f"part {part.name}", part.modules)
        # Pitches are not compared: two instruments may be one matter at two of them.
        # Nor is how they are played.
        is_equal = part_before == part and all(
            getattr(part_before, name, None) == getattr(part, name, None)
            for name in ("pitch", "acts", "loudness")
        )
        if part_before is not None and is_equal:
            return part_before
        memory.hold(f"part {part.name}", (part.modules,), part)
        return part

    def _resolved(self, part: Part, takes: dict[str, Entry]) -> tuple[Module, ...]:
        """The modules of a part with their names looked up."""
        entry, values = self._written[part.name]

        def make_rules() -> rules.ModuleRules:
            laws = self.laws(tuple(part.modules.values()), entry.home)
            return rules.ModuleRules(part, self._part_names, laws, takes, _bodies(values))

        memory = self._uses.files.memory
        return resolve_names(part, self._part_names, make_rules, memory, self.by_name)

    def _struck(self, key: Key) -> None:
        names = {module.name: module for module in key.modules}
        struck = names.get(key.struck)
        if struck is None or struck.kind not in ("MAS", "CEL"):
            place = key.struck.place if isinstance(key.struck, Name) else key.place
            message = (
                f"key {quote(key.name)} is struck at {quote(key.struck)}, "
                "which is not a MAS or CEL of the key"
            )
            names_of = tuple(n for n, m in names.items() if m.kind in ("MAS", "CEL"))
            if key.struck and key.struck not in self._part_names.parts[key.name].broken:
                self._collector.error("E301", message, place, word=key.struck, names=names_of)

    def laws(self, modules: tuple[Module, ...], home: Names) -> dict[str, LawText]:
        """Laws that modules may name: those that ship, those of the score, and those of the
        modules' own file.
        """
        has_named_law = any(
            m.kind == "LNL" and (is_name(m.fields["law"]) or is_name(m.fields["damping"]))
            for m in modules
        )
        if not has_named_law:
            return {}
        tables = [self._names.tables["laws"], home.tables["laws"]]
        files, folder = self._uses.files, self._names.document.folder
        document = files.required("instruments/laws.yaml", folder, self._score.place)
        if document is not None:
            tables.insert(0, self._uses.read(document).tables["laws"])
        laws = {}
        for table in tables:
            for name, law in table.items():
                if isinstance(v := law.values, Values):
                    laws[name] = LawText(v["law"], v["damping"], v.free)
        return laws

    def _layout(self, name: str, place: Place) -> Layout | None:
        folder = self._uses.files.documents[place.file].folder
        return build_mix.layout(name, folder, place, self._uses.files)


def _bodies(values: Values) -> dict[str, Values]:
    """The fields of each module as written, to report places inside laws."""
    bodies = {
        name: body.by_name[body.kind]
        for name, body in (values["modules"] or {}).items()
        if isinstance(body, Values) and isinstance(body.by_name.get(body.kind), Values)
    }
    if values.kind and isinstance(values.by_name.get(values.kind), Values):
        bodies[""] = values.by_name[values.kind]
    return bodies


def _is_refused(value: Any) -> bool:
    """Whether a value that was read, or one in it, was refused."""
    if isinstance(value, Values):
        lacks = len(value.by_name) < len(value.nodes)
        return lacks or any(map(_is_refused, value.by_name.values()))
    return value is MISSING or (isinstance(value, dict) and any(map(_is_refused, value.values())))
