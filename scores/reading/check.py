"""A score as a whole: every name leads somewhere, every instant exists, every rule is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from ergon.instruments import modal, rules
from ergon.instruments.laws import LawText, is_name
from ergon.instruments.model import Instrument, Layout, Module, Target
from ergon.instruments.module_kinds import KINDS, member_count
from ergon.instruments.names import Part, Scene
from ergon.instruments.read import instrument
from ergon.instruments.transpose import moved, named_pitch
from ergon.notation.tables.expressions import lets
from ergon.notation.tables.fields import Values
from ergon.notation.tables.notes import number
from ergon.notation.tables.shapes import MISSING, Name
from ergon.notation.text.document import Document
from ergon.notation.text.errors import quote
from ergon.notation.text.values import Place
from ergon.scores.gesture.notation import MAX_EVENTS
from ergon.scores.reading import automation, build, leads, melodies, overlay, pressed
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.include import MAX_INCLUDED, Include, Played, played
from ergon.scores.reading.melody import Voices
from ergon.scores.reading.piece import (
    Coupling,
    Gesture,
    Key,
    Piece,
    Play,
    Player,
    Strikes,
    TakeFile,
)
from ergon.scores.reading.rates import Rates
from ergon.scores.reading.routing import routed
from ergon.scores.reading.schedule import schedule
from ergon.scores.reading.times import Times
from ergon.scores.reading.uses import Entry, Names, Uses

MAX_MATS = 4_000_000  # of all instruments: about 1 GB of state and parameters
_Named = TypeVar("_Named", Gesture, TakeFile, Key | Instrument)


class Checker:
    """Builds the piece of one score whose names are read; reports all that is wrong."""

    def __init__(self, names: Names, uses: Uses) -> None:
        """Take what was read."""
        assert names.score is not None
        self.names = names
        self.uses = uses
        self.score = names.score
        self.collector = uses.collector
        self.rates = Rates(names.score)
        self.scene = Scene(self.collector)
        self.bodies: dict[str, dict[str, Values]] = {}
        self.written: dict[str, Values] = {}
        self.takes: dict[str, TakeFile] = {}
        self.gestures: dict[str, Gesture | None] = {}
        self._room = MAX_EVENTS  # points that gestures may still have
        self.keys: dict[str, Key] = {}
        self.instruments: dict[str, Instrument] = {}

    def piece(self) -> Piece:
        """The whole piece; its values are good only when nothing was reported."""
        score = self.score
        if not score.written("ergon"):
            message = "the format version is missing; write `ergon: 1` in the first line"
            score.error("W101", message)
        times = Times(score, self.collector, self.uses.files.memory)
        self._played()
        self._parts()
        strikes = [s for v in self._own("strikes") if (s := self._strikes(v)) is not None]
        players = {v.context.name: self._player(v) for v in self._own("players")}
        parts = {name: part for name, (_, part) in self._written.items()}
        mix = routed(build.mix(score["mix"], self.uses.files), parts, self.scene)
        duet = [c for i, v in enumerate(score["duet"] or ()) if (c := self._coupling(v, i))]
        self._reach_led()
        included = self._included(times, len(duet))
        self._modules()
        plays = self._plays(times.known.names())
        changes = [a for v in self.score["automation"] or () if (a := self._automation(v))]
        for _, one in included:
            plays += one.parts
            strikes += one.strikes
            changes += one.automation
            duet += one.duet
            players |= one.players
        gestures = {n: g for n, g in self.gestures.items() if g is not None}
        piece = Piece(
            title=score["title"],
            seed=score["seed"],
            rate=self.rates.audio,
            tempo=times.entries,
            marks=times.marks,
            keys=self.keys,
            instruments=self.instruments,
            gestures=gestures,
            takes=self.takes,
            strikes=tuple(strikes),
            players=players,
            duet=tuple(duet),
            parts=tuple(plays),
            mix=mix,
            render=build.render(score["render"], self.uses.files),
            accuracy=build.accuracy(score["accuracy"]),
            place=score.place,
            tempo_map=times.map,
            automation=tuple(changes),
            blocks={n: own for n, own in (score["blocks"] or {}).items() if own is not MISSING},
            phrases=tuple(self._phrases()),
            families={n: tuple(own.values()) for n, own in self.scene.families.items()},
        )
        begins = times.check(score, piece)
        if self.collector.has_errors():
            return piece
        return replace(piece, starts=schedule(piece, begins, times.known, self.collector))

    # --- what other scores play ------------------------------------------------------------------

    def _included(self, times: Times, n_links: int) -> list[tuple[Include, Played]]:
        """What is included, with all that it names."""
        found: list[tuple[Include, Played]] = []
        n_lines = 0
        taken = {v.context.name: None for v in self._own("strikes")}
        owners: dict[str, Player | None] = {v.context.name: None for v in self._own("players")}
        for one, names in () if self.uses.is_full else self.names.included:
            if not times.exists(one.at, one.values.place_of("at")):
                continue
            file = names.document.file
            if file not in self.uses.pieces:
                self.uses.pieces[file] = Checker(names, self.uses).piece()
            piece = self.uses.pieces[file]
            if self.collector.has_errors():
                continue
            made = played(piece, one, n_links, self.collector)
            n_links += len(made.duet)
            n_lines += len(made)
            if n_lines > MAX_INCLUDED:
                message = f"more than {MAX_INCLUDED:,} lines are included"
                self.collector.error("E105", message, one.place)
                break
            clashes = [f"strikes {quote(s.name)}" for s in made.strikes if s.name in taken]
            clashes += [
                f"player {quote(name)}"
                for name, player in made.players.items()
                if owners.get(name, player) != player
            ]
            for clash in clashes:
                message = f"{clash} of {file} is already defined; give its names a prefix"
                self.collector.error("E303", message, one.place, help="include: {file: x, as: v2}")
            taken |= {s.name: None for s in made.strikes}
            owners |= made.players
            self._reach_included(piece, one.prefix)
            found.append((one, made))
        return found

    def _reach_included(self, piece: Piece, prefix: str) -> None:
        tables = self.names.tables
        head = f"{prefix}." if prefix else ""
        self.scene.reached |= {head + name for name in (*piece.keys, *piece.instruments)}
        for name in piece.gestures:
            if (full := head + name) in tables["gestures"]:
                self._gesture(full, tables["gestures"][full])
            elif full in tables["takes"]:
                self._pressed(full, tables["takes"][full])
        for name in piece.takes:
            if (full := head + name) in tables["takes"]:
                self._take(full, tables["takes"][full])

    # --- what is there --------------------------------------------------------------------------

    def _own(self, section: str) -> list[Values]:
        return [v for v in (self.score[section] or {}).values() if isinstance(v, Values)]

    def _played(self) -> None:
        """One's own gestures and takes; those of other files when something plays them."""
        tables = self.names.tables
        for name, entry in tables["gestures"].items():
            if entry.brought is None:
                self._gesture(name, entry)
            if name in tables["takes"]:
                place = _place_of(entry) or self.score.place
                message = (
                    f"{quote(name)} is the name of a gesture and of a take; rename one of them"
                )
                self.collector.error("E303", message, place)
        for name, entry in tables["takes"].items():
            if entry.brought is None:
                self._take(name, entry)

    def _gesture(self, name: str, entry: Entry) -> None:
        if name not in self.gestures:
            values, _ = self.uses.resolved("gestures", entry)
            made = build.gesture(values, self._room) if values is not None else None
            self.gestures[name] = _called(made, name) if made else None
            self._room -= len(made.points) if made else 0

    def _take(self, name: str, entry: Entry) -> None:
        if name not in self.takes and isinstance(entry.values, Values):
            made = _called(build.take(entry.values, self.uses.files), name)
            if not melodies.is_midi(entry.values):
                self.takes[name] = made

    def _pressed(self, name: str, entry: Entry) -> None:
        """A MIDI take that a hand plays is a gesture."""
        if name not in self.gestures:
            self._take(name, entry)
            made = pressed.gesture(entry.values, self.uses.files, self._room)
            self.gestures[name] = _called(made, name) if made else None
            self._room -= len(made.points) if made else 0

    def _reach_played(self, name: Name, who: str) -> None:
        """The gesture or take of a name becomes part of the piece; reports when there is none."""
        tables = self.names.tables
        if name in tables["gestures"]:
            self._gesture(name, tables["gestures"][name])
        elif name in tables["takes"] and melodies.is_midi(tables["takes"][name].values):
            self._pressed(name, tables["takes"][name])
        elif name in tables["takes"]:
            self._take(name, tables["takes"][name])
        else:
            message = f"{who}: no gesture or take is called {quote(name)}"
            names = (*tables["gestures"], *tables["takes"])
            self.collector.error("E301", message, name.place, word=str(name), names=names)

    # --- keys and instruments -------------------------------------------------------------------

    def _parts(self) -> None:
        """All keys and instruments by name, so that modules can reach each other."""
        self._written: dict[str, tuple[Entry, Key | Instrument]] = {}
        for section in ("keys", "instruments"):
            for name, entry in self.names.tables[section].items():
                if name in self._written:
                    message = (
                        f"{quote(name)} is the name of a key and of "
                        "an instrument; rename one of them"
                    )
                    self.collector.error("E303", message, _place_of(entry) or self.score.place)
                    continue
                values, selves = self.uses.resolved(section, entry)
                if values is None:
                    self.scene.broken.add(name)
                    continue
                if section == "instruments" and values.written("notes"):
                    self._notes(name, entry, values, selves)
                else:
                    self._part(section, name, entry, values, selves)

    def _part(
        self, section: str, name: str, entry: Entry, values: Values, selves: frozenset[str]
    ) -> None:
        values = self._with_modes(values)
        part_object = _called(self._made(section, entry, values), name)
        struck = part_object.struck if isinstance(part_object, Key) else None
        modules = {module.name: module for module in part_object.modules}
        broken = frozenset(values["modules"] or {}).difference(modules)
        self.scene.parts[name] = Part(name, modules, struck, entry.prefix, broken, selves)
        self._written[name] = (entry, part_object)
        self.bodies[name] = _bodies(values)
        self.written[name] = values

    def _with_modes(self, values: Values) -> Values:
        """The values with the modes of the files that BANKs name."""

        def read(file: str, place: Place) -> Document | None:
            files = self.uses.files
            return files.plain(file, files.documents[place.file].folder, place)

        def filled(owner: Values) -> Values:
            body = owner.given.get(owner.kind)
            if owner.kind != "BANK" or not isinstance(body, Values) or not body.written("modes"):
                return owner
            said = modal.from_file(body, read, moved, self.collector)
            return replace(owner, given={**owner.given, "BANK": said})

        own = filled(values)
        modules = values["modules"] or {}
        said = {n: filled(one) if isinstance(one, Values) else one for n, one in modules.items()}
        if any(said[n] is not one for n, one in modules.items()):
            own = replace(own, given={**own.given, "modules": said})
        return own

    def _notes(self, name: str, entry: Entry, values: Values, selves: frozenset[str]) -> None:
        """An instrument of each note, which is called by it: `string.F3`."""
        notes = values["notes"]
        if notes is None:
            self.scene.broken.add(name)
            return
        if named_pitch(values) is None:
            reason = "its modules have no named pitch; write `f`, at which they are written"
            if values.kind == "BANK":
                reason = "a BANK has pitches of its own"
            values.error("E103", f"{values.context.of('notes')}: {reason}", "notes")
            self.scene.broken.add(name)
            return
        self.scene.families[name] = {number(note) or 0: f"{name}.{note}" for note in notes}
        known = self.scene.families[name]
        for word, own in (values["members"] or {}).items():
            if number(word) not in known:
                message = f"{values.context.of('members')}: it has no note {quote(word)}"
                self.collector.error("E301", message, own.place, word=word, names=notes)
        for note in notes:
            part = f"{name}.{note}"
            self._part("instruments", part, entry, overlay.at(values, note), selves | {name})

    def _made(self, section: str, entry: Entry, values: Values) -> Key | Instrument:
        make: Callable[[Values], Key | Instrument] = instrument
        if section == "keys":
            make = partial(build.key, files=self.uses.files)
        memory = self.uses.files.memory
        is_file_read = section == "keys" and values["calib"] is not None
        # What begins with another is merged anew.
        if memory is None or values is not entry.values or is_file_read:
            return make(values)
        # Under its name, for an alias is one node of several names.
        named = tuple(lets(values.node.document).names.items())
        key = section, values.node, values.context.name, named
        return memory.made(key, partial(make, values))

    def _modules(self) -> None:
        """Look up the names in all parts that belong to the piece, and in those they lead to."""
        todo = [n for n, (entry, _) in self._written.items() if entry.brought is None]
        todo += sorted(self.scene.reached - set(todo))
        done: set[str] = set()
        total = 0
        while todo:
            name = todo.pop(0)
            if name in done or name not in self._written:
                continue
            done.add(name)
            entry, made = self._written[name]
            part = self.scene.parts[name]
            takes = self.names.tables["takes"]
            modules = self._resolved(part, entry.home, made.modules, takes)
            total += sum(member_count(m.kind, m.fields) for m in modules)
            for module in modules:
                if isinstance(source := module.fields.get("from"), Name) and source in takes:
                    self._take(source, takes[source])
            if isinstance(made, Key):
                self._struck(made)
                every = self.rates.of_key(self.written[name])
                self.keys[name] = replace(made, modules=modules, every=every)
            else:
                outputs = rules.outputs(part, made.outputs, self.scene, self._layout)
                every = self.rates.of_instrument(self.written[name])
                self.instruments[name] = replace(
                    made, modules=modules, outputs=outputs, every=every
                )
            todo += sorted(self.scene.reached - done)
            if total > MAX_MATS:
                message = f"the piece has more than {MAX_MATS:,} masses"
                self.collector.error("E105", message, made.place)
                break
        order = list(self._written)
        self.keys = {n: self.keys[n] for n in order if n in self.keys}
        self.instruments = {n: self.instruments[n] for n in order if n in self.instruments}

    def _resolved(
        self, part: Part, home: Names, written: tuple[Module, ...], takes: dict[str, Entry]
    ) -> tuple[Module, ...]:
        """The modules of a part with their names looked up: as before, where nothing that they can
        reach has changed."""

        def make() -> tuple[tuple[Module, ...], frozenset[str], object]:
            before, self.scene.reached = self.scene.reached, set()
            laws = self._laws(home, written)
            own = rules.modules(part, self.scene, laws, takes, self.bodies[part.name])
            reached = frozenset(self.scene.reached)
            self.scene.reached |= before
            return own, reached, known

        memory = self.uses.files.memory
        known = [made for _, made in self._written.values()]
        drives = any(module.kind in ("ENX", "ENF", "LNL") for module in written)
        if memory is None or drives or self.scene.broken:
            return make()[0]
        # What is kept holds the parts, so that no other has the number of one of them.
        key = rules.modules, part.name, part.prefix, part.selves, tuple(map(id, known))
        own, reached, _ = memory.made(key, make)
        self.scene.reached |= reached
        return own

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
            if key.struck and key.struck not in self.scene.parts[key.name].broken:
                self.collector.error("E301", message, place, word=key.struck, names=names_of)

    def _laws(self, home: Names, modules: tuple[Module, ...]) -> dict[str, LawText]:
        """Laws that a part may name: those of its own file, and those that ship."""
        has_named_law = any(
            m.kind == "LNL" and (is_name(m.fields["law"]) or is_name(m.fields["damping"]))
            for m in modules
        )
        if not has_named_law:
            return {}
        tables = [self.names.tables["laws"], home.tables["laws"]]
        files, folder = self.uses.files, self.names.document.folder
        document = files.required("instruments/laws.yaml", folder, self.score.place)
        if document is not None:
            tables.insert(0, self.uses.read(document).tables["laws"])
        laws = {}
        for table in tables:
            for name, law in table.items():
                if isinstance(v := law.values, Values):
                    laws[name] = LawText(v["law"], v["damping"], v.free)
        return laws

    def _layout(self, name: str, place: Place) -> Layout | None:
        folder = self.uses.files.documents[place.file].folder
        return build.layout(name, folder, place, self.uses.files)

    # --- who plays what, and where it goes ------------------------------------------------------

    def _player(self, values: Values) -> Player:
        player = build.player(values)
        who = values.context.of("key")
        keys = self.names.tables["keys"]
        if player.key not in keys:
            message = f"{who}: no key is called {quote(player.key)}"
            values.error("E301", message, "key", word=player.key, names=tuple(keys))
        self.scene.reached.add(player.key)
        if isinstance(player.standin, Name):
            self._reach_played(player.standin, values.context.of("standin"))
        return player

    def _plays(self, known: dict[int, tuple[Play, tuple[str, ...]]]) -> list[Play]:
        """The lines of all parts; what they name, where it is not `known`, is noted there."""
        plays: list[Play] = []
        section = self.score.nodes.get("parts")
        entries = getattr(section, "entries", {})
        for name, part in (self.score["parts"] or {}).items():
            if name not in (self.score["players"] or {}):
                message = f"no player is called {quote(name)}"
                place = entries[name][0].place
                player_names = tuple(self.score["players"] or {})
                self.collector.error("E301", message, place, word=name, names=player_names)
            if part is MISSING:
                continue
            found: set[str] = set()
            for play in part:
                one = known.get(id(play))
                if one is None:
                    one = known[id(play)] = play, play.names
                if found.issuperset(one[1]):
                    continue
                for word in one[1]:
                    if isinstance(word, Name):
                        self._reach_played(word, f"part of {quote(name)}")
                        is_there = word in self.gestures or word in self.takes
                        found |= {str(word)} if is_there else set()
            plays += part
        return plays

    def _strikes(self, values: Values) -> Strikes | None:
        if not melodies.is_whole(values):
            return None
        if melodies.kind_of(values):
            found = melodies.hits_of(values, self.scene, self._phrases(), self.uses.files)
            return None if found is None else build.melody(values, *found)
        who = f"strikes {quote(values.context.name)}"
        names = values["to"] or ()
        targets = tuple(t for name in names for t in self.scene.targets(name, "mats", who))
        made = build.strikes(values, targets)
        if made.notes and names and all(self.scene.family(name) for name in names):
            return melodies.voiced(made, values, Voices(self.scene, names), who)
        for target in made.to if made.notes else ():
            self._has_pitch(target, who)
        return made

    def _phrases(self) -> dict[str, Any]:
        """Phrases, and takes that are MIDI files."""
        tables = self.names.tables
        known = {n: e.values for n, e in tables["takes"].items() if melodies.is_midi(e.values)}
        return {**known, **{name: entry.values for name, entry in tables["phrases"].items()}}

    def _has_pitch(self, target: Target, who: str) -> None:
        """Report a target that is not one CEL with values in SI units."""
        part = self.scene.parts[target.part]
        made = self._written[target.part][1]
        is_ca = isinstance(made, Instrument) and made.ca_rate is not None
        if part.modules[target.module].kind != "CEL" or is_ca:
            message = f"{who}: {quote(target.text)} has no pitch of its own; notes are for CELs"
            self.collector.error("E304", message, target.place)

    def _reach_led(self) -> None:
        """What automation changes belongs to the piece."""
        for values in self.score["automation"] or ():
            if isinstance(values, Values):
                words = str(values["set"] or values["lfo"] or "").split(".")
                heads = (".".join(words[:count]) for count in range(len(words) - 1, 0, -1))
                self.scene.reached |= {head for head in heads if head in self._written}

    def _automation(self, values: Any) -> Automation | None:
        if not isinstance(values, Values) or not automation.check(values):
            return None
        name = values["set"] or values["lfo"]
        head, _, parameter = str(name).rpartition(".")
        known = leads.found(head, self.keys, self.instruments)
        if known is None and head and parameter in leads.ALL:
            # What the head reaches, or what is wrong with it.
            target = self.scene.target(Name(head, name.place), "mat", "automation")
            if target is None:
                return None
            known = leads.found(
                f"{target.part}.{target.module}".rstrip("."), self.keys, self.instruments
            )
            if known is not None and KINDS[known[1].kind].family == "generator":
                message = f"automation: {quote(head)} is a member; its body changes as a whole"
                self.collector.error("E304", message, name.place)
                return None
        if known is None:
            words = ", ".join(leads.ALL)
            message = f"automation: {quote(name)} is not a parameter that changes ({words})"
            self.collector.error("E301", message, name.place)
            return None
        part, module, is_ca = known
        if why := leads.refusal(module, parameter, is_ca=is_ca):
            self.collector.error("E304", f"automation: {quote(head)} {why}", name.place)
            return None
        target = Target(part, module.name, 0, 1, head, name.place)
        return automation.made(values, target, module, parameter)

    def _coupling(self, values: Any, number: int) -> Coupling | None:
        made = build.coupling(values, number) if isinstance(values, Values) else None
        if made is None:
            return None
        keys = self.names.tables["keys"]
        ends = []
        for name in values["couple"]:
            if name not in keys:
                message = f"coupling: no key is called {quote(name)}"
                self.collector.error("E301", message, name.place, word=name, names=tuple(keys))
                return None
            ends.append(self.scene.target(name, "mat", "coupling"))
        a, b = ends
        if a is None or b is None:
            return None
        if (a.part, a.module) == (b.part, b.module):
            message = "coupling: a key cannot be coupled with itself; name two keys"
            self.collector.error("E304", message, b.place)
        laws = self._laws(self.names, (made.link,))
        who = f"{made.link.kind} of a coupling"
        link = rules.lawful(made.link, laws, values.given[values.kind], who, self.collector)
        return replace(made, link=link, a=a, b=b)


def _called(made: _Named, name: str) -> _Named:
    """The thing under the name by which this score knows it."""
    return made if made.name == name else replace(made, name=name)


def _place_of(entry: Entry) -> Place | None:
    return entry.values.place if isinstance(entry.values, Values) else entry.brought


def _bodies(values: Values) -> dict[str, Values]:
    """The fields of each module as written, for places inside laws."""
    bodies = {
        name: body.given[body.kind]
        for name, body in (values["modules"] or {}).items()
        if isinstance(body, Values) and isinstance(body.given.get(body.kind), Values)
    }
    if values.kind and isinstance(values.given.get(values.kind), Values):
        bodies[""] = values.given[values.kind]
    return bodies
