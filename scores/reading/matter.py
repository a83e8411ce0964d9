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
from ergon.instruments.names import NoteFamily, PartContents, PartNames
from ergon.instruments.read import make_instrument
from ergon.instruments.space import mesh_file
from ergon.instruments.transpose import named_pitch, transposed_value
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
from ergon.scores.reading.uses import Entry, Names, Uses, with_name

_Item = TypeVar("_Item")
_Part = TypeVar("_Part", Key, Instrument)

MAX_MATS = 4_000_000  # MATs of all instruments: about 1 GB


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
        self._written_parts: dict[str, tuple[Entry, Values]] = {}
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
        for section_name in ("keys", "instruments"):
            for part_name, named_entry in self._names.tables[section_name].items():
                if part_name in self._written_parts:
                    message = (
                        f"{quote(part_name)} is the name of a key and of "
                        "an instrument; rename one of them"
                    )
                    self._collector.error("E303", message, named_entry.place or self._score.place)
                    continue
                resolved_values, self_names = self._uses.resolved(section_name, named_entry)
                if resolved_values is None:
                    self._part_names.refused_parts.add(part_name)
                    continue
                tuned = self._uses.tuning_of(named_entry) if section_name == "instruments" else None
                if tuned is not None:
                    self._part_names.tunings[part_name] = tuned
                with tuning.used(tuned or self._names.tuning):
                    if section_name == "instruments" and resolved_values.written("notes"):
                        self._read_notes(part_name, named_entry, resolved_values, self_names)
                    else:
                        self._add_part(
                            section_name, part_name, named_entry, resolved_values, self_names
                        )

    def _add_part(
        self, section: str, part_name: str, entry: Entry, values: Values, self_names: frozenset[str]
    ) -> None:
        values = self._with_files(values)
        part_object = with_name(self._read_part(section, part_name, entry, values), part_name)
        struck_module = part_object.struck if isinstance(part_object, Key) else None
        modules_by_name = {module.name: module for module in part_object.modules}
        refused_modules = frozenset(values["modules"] or {}).difference(modules_by_name)
        n_axes, acts = 1, {}
        if isinstance(part_object, Instrument):
            n_axes, acts = part_object.axes, {act.name: act for act in part_object.acts}
        if values.written("out") and "out" not in values.by_name:
            self._part_names.refused_parts.add(part_name)
        self._part_names.parts[part_name] = PartContents(
            part_name,
            modules_by_name,
            struck_module,
            entry.prefix,
            refused_modules,
            self_names,
            n_axes,
            acts,
        )
        if acts:
            label = values.context.label("ready")
            self._part_names.add_modules_of_acts(
                self._part_names.parts[part_name], values["ready"] or (), label
            )
        self._written_parts[part_name] = entry, values
        self.by_name[part_name] = part_object

    def _with_files(self, values: Values) -> Values:
        """The values, completed by the content of files that BANK, MODES, MESH and BUT name."""

        def read(file: str, place: Place, decoder: Decoder = decode) -> Document | None:
            files = self._uses.files
            return files.plain(file, files.documents[place.file].folder, place, decoder)

        def fill_body(owner_values: Values) -> Values:
            body_values = owner_values.by_name.get(owner_values.kind)
            if not isinstance(body_values, Values):
                return owner_values
            if owner_values.kind in ("BANK", "MODES") and body_values.written("modes"):
                filled_body = modal.with_modes_of_file(
                    body_values, read, transposed_value, self._collector
                )
            elif owner_values.kind == "MESH" and body_values.written("file"):
                filled_body = mesh_file.with_mesh_of_file(body_values, read, self._collector)
            elif owner_values.kind == "BUT" and isinstance(
                wall_mesh := body_values.by_name.get("mesh"), Values
            ):
                wall_mesh = mesh_file.with_mesh_of_file(wall_mesh, read, self._collector)
                filled_body = replace(
                    body_values, by_name={**body_values.by_name, "mesh": wall_mesh}
                )
            else:
                return owner_values
            return replace(
                owner_values, by_name={**owner_values.by_name, owner_values.kind: filled_body}
            )

        filled_values = fill_body(values)
        module_bodies = values["modules"] or {}
        filled_modules = {
            n: fill_body(module) if isinstance(module, Values) else module
            for n, module in module_bodies.items()
        }
        if any(filled_modules[n] is not module for n, module in module_bodies.items()):
            filled_values = replace(
                filled_values, by_name={**filled_values.by_name, "modules": filled_modules}
            )
        return filled_values

    def _read_notes(
        self, name: str, entry: Entry, values: Values, self_names: frozenset[str]
    ) -> None:
        """Make an instrument for each note, with the note in its name: `string.F3`."""
        note_names = values["notes"]
        if note_names is None:
            self._part_names.refused_parts.add(name)
            return
        if named_pitch(values) is None:
            refusal_reason = "its modules have no named pitch; write `f`, at which they are written"
            if values.kind == "BANK":
                refusal_reason = "a BANK has pitches of its own"
            # A field that was refused, which is reported already, may have said it.
            if not (self._collector.has_errors() and _is_refused(values)):
                values.error("E103", f"{values.context.label('notes')}: {refusal_reason}", "notes")
            self._part_names.refused_parts.add(name)
            return
        part_by_pitch = {pitch(note) or 0.0: f"{name}.{note}" for note in note_names}
        family = self._part_names.families[name] = NoteFamily(part_by_pitch, tuning.written())
        for note_word, member in (values["members"] or {}).items():
            if family.note(note_word) is None:
                message = f"{values.context.label('members')}: it has no note {quote(note_word)}"
                self._collector.error(
                    "E301", message, member.place, word=note_word, names=note_names
                )
        for note in note_names:
            note_part = f"{name}.{note}"
            values_at_pitch = self._values_at_note(note_part, values, note, entry.values)
            self._add_part("instruments", note_part, entry, values_at_pitch, self_names | {name})

    def _values_at_note(
        self, part_name: str, instrument_values: Values, note_name: str, member: object
    ) -> Values:
        """The values of an instrument, whose `member` may move all its notes, at one of them."""
        interval = member.by_name.get("transpose") if isinstance(member, Values) else None
        memory, memory_key = self._uses.files.memory, f"note {part_name}"
        old_values = None if memory is None else memory.held_for(memory_key, instrument_values)
        if old_values is not None and old_values[0] == interval:
            values_at_pitch: Values = old_values[1]
            return values_at_pitch
        n_reports = self._collector.n_reports
        values_at_pitch = overlay.shifted_note(instrument_values, note_name, interval)
        if memory is not None and self._collector.n_reports == n_reports:
            memory.hold(memory_key, (instrument_values,), (interval, values_at_pitch))
        return values_at_pitch

    def _read_part(
        self, section_name: str, part_name: str, named_entry: Entry, part_values: Values
    ) -> Key | Instrument:
        memory = self._uses.files.memory
        amounts_by_name = tuple(named_amounts(part_values.node.document).names.items())
        make_part: Callable[[Values], Key | Instrument] = partial(self._instrument, amounts_by_name)
        if section_name == "keys":
            make_part = partial(build.key, files=self._uses.files)
        is_file_read = section_name == "keys" and part_values["calib"] is not None
        if memory is None or is_file_read:
            return make_part(part_values)
        # The key has the name too, because one node may have several names (a YAML alias).
        node_key = section_name, part_values.node, part_values.context.name, amounts_by_name
        if part_values is named_entry.values:
            return memory.recall(node_key, partial(make_part, part_values))
        # Values that were merged (`like`, `from`) have the node of one of them.
        memory_key = f"made {section_name} {part_name} {part_values.node.document.file}"
        old_part = memory.held(memory_key, amounts_by_name)
        if old_part is not None and old_part[0] is part_values:
            return old_part[1]  # type: ignore[no-any-return]
        n_reports = self._collector.n_reports
        new_part = make_part(part_values)
        if self._collector.n_reports == n_reports:
            memory.hold(memory_key, amounts_by_name, (part_values, new_part))
        return new_part

    def _instrument(self, amounts_key: Hashable, values: Values) -> Instrument:
        """An instrument, of which only modules that have changed are read; `amounts_key` are the
        values of `let`.
        """
        memory = self._uses.files.memory
        if memory is None:
            return make_instrument(values)
        memory_key = f"read {values.context.name} {values.node.document.file}"
        old_modules: dict[Hashable, Any] = memory.held(memory_key, amounts_key) or {}
        new_modules: dict[Hashable, Any] = {}

        def recall(module_key: Hashable, make: Callable[[], _Item]) -> _Item:
            n_reports = self._collector.n_reports
            recalled_module: _Item = (
                old_modules[module_key] if module_key in old_modules else make()
            )
            if self._collector.n_reports == n_reports:
                new_modules[module_key] = recalled_module
            return recalled_module

        instrument = make_instrument(values, recall)
        memory.hold(memory_key, amounts_key, new_modules)
        return instrument

    def resolve_reached_parts(self) -> None:
        """Look up the names in all parts that belong to the piece, and in those they lead to."""
        unresolved_names = [
            part_word
            for part_word, (entry, _) in self._written_parts.items()
            if entry.brought_place is None
        ]
        unresolved_names += sorted(self._part_names.referenced_parts - set(unresolved_names))
        resolved_names: set[str] = set()
        mat_total = 0
        while unresolved_names:
            part_name = unresolved_names.pop(0)
            if part_name in resolved_names or part_name not in self._written_parts:
                continue
            resolved_names.add(part_name)
            _, part_values = self._written_parts[part_name]
            part_object = self.by_name[part_name]
            named_part = self._part_names.parts[part_name]
            takes = self._names.tables["takes"]
            resolved_modules = self._resolved(named_part, takes)
            n_mats, take_names = self._count_contents(part_name, resolved_modules)
            mat_total += n_mats
            for take_name in take_names:
                if take_name in takes:
                    self._gestures_and_takes.add_take(take_name, takes[take_name])
            if isinstance(part_object, Key):
                self._check_struck(part_object)
                step_frames = self._rates.key_step_frames(part_values)
                self.keys[part_name] = self._reused_part(
                    replace(part_object, modules=resolved_modules, every=step_frames)
                )
            else:
                acts = tuple(
                    self._part_names.resolved_act(named_part, act)
                    for act in named_part.acts.values()
                )
                resolved_outputs = rules.resolved_outputs(
                    named_part, part_object.outputs, self._part_names, self._layout
                )
                step_frames = self._rates.instrument_step_frames(part_values)
                self.instruments[part_name] = self._reused_part(
                    replace(
                        part_object,
                        modules=resolved_modules,
                        outputs=resolved_outputs,
                        every=step_frames,
                        acts=acts,
                    )
                )
            unresolved_names += sorted(self._part_names.referenced_parts - resolved_names)
            if mat_total > MAX_MATS:
                message = f"the piece has more than {MAX_MATS:,} masses"
                self._collector.error("E105", message, part_object.place)
                break
        part_order = list(self._written_parts)
        self.keys = {
            part_word: self.keys[part_word] for part_word in part_order if part_word in self.keys
        }
        self.instruments = {
            part_word: self.instruments[part_word]
            for part_word in part_order
            if part_word in self.instruments
        }

    def _count_contents(
        self, part_name: str, part_modules: tuple[Module, ...]
    ) -> tuple[int, tuple[str, ...]]:
        """The number of masses of modules, and the takes that they name."""
        memory = self._uses.files.memory
        old_contents = (
            None if memory is None else memory.held_for(f"contents {part_name}", part_modules)
        )
        if old_contents is None:
            n_mats = sum(
                member_count(part_module.kind, part_module.fields)
                * part_module.fields.get("axes", 1)
                for part_module in part_modules
            )
            sources = (module.fields.get("from") for module in part_modules)
            old_contents = (
                n_mats,
                tuple([source for source in sources if isinstance(source, Name)]),
            )
            if memory is not None:
                memory.hold(f"contents {part_name}", (part_modules,), old_contents)
        return old_contents

    def _reused_part(self, part: _Part) -> _Part:
        """The part of the reading before, if it has the same modules and is equal."""
        memory = self._uses.files.memory
        if memory is None:
            return part
        old_part: _Part | None = memory.held_for(f"part {part.name}", part.modules)
        # Pitches are not compared: two instruments may be one matter at two of them.
        # Nor is how they are played.
        is_equal = old_part == part and all(
            getattr(old_part, name, None) == getattr(part, name, None)
            for name in ("pitch", "acts", "loudness")
        )
        if old_part is not None and is_equal:
            return old_part
        memory.hold(f"part {part.name}", (part.modules,), part)
        return part

    def _resolved(self, part: PartContents, takes: dict[str, Entry]) -> tuple[Module, ...]:
        """The modules of a part with their names looked up."""
        named_entry, part_values = self._written_parts[part.name]

        def make_rules() -> rules.ModuleRules:
            laws = self.laws(tuple(part.modules.values()), named_entry.names)
            return rules.ModuleRules(
                part, self._part_names, laws, takes, _written_fields(part_values)
            )

        memory = self._uses.files.memory
        return resolve_names(part, self._part_names, make_rules, memory, self.by_name)

    def _check_struck(self, key: Key) -> None:
        modules_by_name = {module.name: module for module in key.modules}
        struck_module = modules_by_name.get(key.struck)
        if struck_module is None or struck_module.kind not in ("MAS", "CEL"):
            struck_place = key.struck.place if isinstance(key.struck, Name) else key.place
            message = (
                f"key {quote(key.name)} is struck at {quote(key.struck)}, "
                "which is not a MAS or CEL of the key"
            )
            struck_names = tuple(
                name
                for name, key_module in modules_by_name.items()
                if key_module.kind in ("MAS", "CEL")
            )
            if key.struck and key.struck not in self._part_names.parts[key.name].refused_modules:
                self._collector.error(
                    "E301", message, struck_place, word=key.struck, names=struck_names
                )

    def laws(self, modules: tuple[Module, ...], law_names: Names) -> dict[str, LawText]:
        """Laws that modules may name: those that ship, those of the score, and those of the
        modules' own file.
        """
        has_named_law = any(
            module.kind == "LNL"
            and (is_name(module.fields["law"]) or is_name(module.fields["damping"]))
            for module in modules
        )
        if not has_named_law:
            return {}
        law_tables = [self._names.tables["laws"], law_names.tables["laws"]]
        files, folder = self._uses.files, self._names.document.folder
        document = files.required("instruments/laws.yaml", folder, self._score.place)
        if document is not None:
            law_tables.insert(0, self._uses.read(document).tables["laws"])
        laws = {}
        for table in law_tables:
            for name, law in table.items():
                if isinstance(law_values := law.values, Values):
                    laws[name] = LawText(law_values["law"], law_values["damping"], law_values.free)
        return laws

    def _layout(self, name: str, place: Place) -> Layout | None:
        folder = self._uses.files.documents[place.file].folder
        return build_mix.layout(name, folder, place, self._uses.files)


def _written_fields(instrument_values: Values) -> dict[str, Values]:
    """The fields of each module as written, to report places inside laws."""
    bodies_by_name = {
        name: body.by_name[body.kind]
        for name, body in (instrument_values["modules"] or {}).items()
        if isinstance(body, Values) and isinstance(body.by_name.get(body.kind), Values)
    }
    if instrument_values.kind and isinstance(
        instrument_values.by_name.get(instrument_values.kind), Values
    ):
        bodies_by_name[""] = instrument_values.by_name[instrument_values.kind]
    return bodies_by_name


def _is_refused(checked_value: Any) -> bool:
    """Whether a value that was read, or one in it, was refused."""
    if isinstance(checked_value, Values):
        is_incomplete = len(checked_value.by_name) < len(checked_value.nodes)
        return is_incomplete or any(map(_is_refused, checked_value.by_name.values()))
    return checked_value is MISSING or (
        isinstance(checked_value, dict) and any(map(_is_refused, checked_value.values()))
    )
