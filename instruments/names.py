"""Looks up names of modules: `m`, `bell.m`, `gong.centre`, `string.3..8`, `sky.all`, a key."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ergon.instruments.members import PATTERN, parse_members
from ergon.instruments.model import Act, Module, Target
from ergon.instruments.module_kinds import LINK_KINDS, POINT_KINDS, member_count
from ergon.instruments.spread import link_count as n_links
from ergon.notation.tables import tuning
from ergon.notation.tables.notes import pitch
from ergon.notation.tables.quantities import note_slip
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import ImpulseRange
from ergon.notation.tables.tuning import Tuning
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.errors import Collector, TextError, quote

_NAME_WITH_MEMBERS = re.compile(rf"(.*?)(?:\.({PATTERN}))?")

WantedFamily = Literal["mat", "mats", "body", "point", "points", "link", "links"]


@dataclass(slots=True)
class PartContents:
    """The names in a key or an instrument."""

    name: str
    modules: Mapping[str, Module]
    struck_mat: str | None = None  # a key's MAT that ergons strike
    prefix: str = ""  # prefix of its file
    refused_modules: frozenset[str] = frozenset()  # modules that were refused: reported already
    self_names: frozenset[str] = frozenset()  # names for itself, with those it was copied from
    axes: int = 1  # 2 or 3 for an instrument in space
    acts: Mapping[str, Act] = field(default_factory=dict)  # how it is played, the usual one first

    @property
    def mats(self) -> list[str]:
        """Names of modules that have <M> points."""
        return [name for name, module in self.modules.items() if module.kind in POINT_KINDS]


@dataclass(frozen=True, slots=True)
class NoteFamily:
    """An instrument with notes: the part of each note by its pitch, in its tuning."""

    parts: Mapping[float, str]
    tuning: Tuning | None

    def note(self, word: str) -> str | None:
        """The part of a note by the word of its pitch; None if there is none."""
        with tuning.used(self.tuning):
            try:
                note_height = pitch(word)
            except TextError:  # a key that the tuning leaves out
                return None
        return None if note_height is None else tuning.part_at_height(self.parts, note_height)


@dataclass(slots=True)
class PartNames:
    """All parts of a piece, by name."""

    collector: Collector
    parts: dict[str, PartContents] = field(default_factory=dict)
    refused_parts: set[str] = field(default_factory=set)  # parts that were refused
    referenced_parts: set[str] = field(default_factory=set)  # parts that some name refers to
    searched_parts: set[str] = field(default_factory=set)  # parts in which some name was looked for
    families: dict[str, NoteFamily] = field(default_factory=dict)  # instruments with `notes`
    tuning: Tuning | None = None  # tuning of the score
    tunings: dict[str, Tuning] = field(default_factory=dict)  # tunings of instruments that have one

    def targets(self, name: Name, wanted: WantedFamily, label: str) -> list[Target]:
        """The targets of a name; for an instrument with notes one for each note.

        If one is not found, that is reported once, and there are none.
        """
        targets = []
        for member_name in self.member_names(name):
            target = self.target(member_name, wanted, label)
            if target is None:
                return []
            targets.append(target)
        return targets

    def struck_targets(self, name: Name, who: str) -> list[Target]:
        """The MATs that strikes reach by a name: where it names an instrument, or an act of one
        (`kick.strike`), those of the act; there are none if an error was reported.
        """
        targets = []
        for member_name in self.member_names(name):
            part, act = self._named_act(member_name)
            if act is None:
                target = self.target(member_name, "mats", who)
                if target is None:
                    return []
                targets.append(target)
                continue
            # What is wrong with the act itself is reported where it is written.
            silent_names = replace(self, collector=Collector())
            self.referenced_parts.add(part.name)
            self._add_modules_of_act(part, act)
            act_targets = silent_names.act_targets(part, act)
            targets += [
                replace(act_target, text=str(member_name), place=member_name.place)
                for act_target in act_targets
            ]
        return targets

    def act_targets(self, act_owner: PartContents, act: Act) -> list[Target]:
        """The MATs that an act of an instrument strikes; reports what is wrong with its names."""
        if act.at:
            return self._targets_inside(act_owner, act, act.at)
        target = self.target(Name(act_owner.name, act.place), "mats", _play_label(act_owner))
        return [] if target is None else [target]

    def resolved_act(self, act_owner: PartContents, act: Act) -> Act:
        """An act with what it strikes; reports what is wrong with its names."""
        holds = tuple(
            replace(hold, targets=tuple(self._targets_inside(act_owner, act, hold.at)))
            for hold in act.holds
        )
        return replace(act, targets=tuple(self.act_targets(act_owner, act)), holds=holds)

    def _targets_inside(self, owner: PartContents, act: Act, names: Iterable[Name]) -> list[Target]:
        """The MATs of names that are written inside an instrument, for one of its acts."""
        owner = replace(owner, modules=_with_act_modules(owner.modules, act))
        reached_targets = (self.target(name, "mats", _play_label(owner), owner) for name in names)
        return [target for target in reached_targets if target is not None]

    def add_modules_of_struck(self, struck_target: Target) -> None:
        """Add the modules of the act that strikes a target, if they are not there yet."""
        target_part = self.parts.get(struck_target.part)
        if target_part is None or struck_target.module in target_part.modules:
            return
        for act in target_part.acts.values():
            if any(module.name == struck_target.module for module in act.modules):
                self._add_modules_of_act(target_part, act)

    def add_modules_of_acts(
        self, act_owner: PartContents, names: Sequence[Name], module_label: str
    ) -> None:
        """Add the modules of acts by their names; reports names of none."""
        for act_name in names:
            if act_name in act_owner.acts:
                self._add_modules_of_act(act_owner, act_owner.acts[act_name])
            else:
                known = tuple(act_owner.acts)
                problem_text = f"{quote(act_owner.name)} has no act {quote(act_name)}"
                self._refuse(
                    act_name, module_label, problem_text, "E301", word=str(act_name), names=known
                )

    def _add_modules_of_act(self, owner: PartContents, act: Act) -> None:
        owner.modules = _with_act_modules(owner.modules, act)

    def impulse_range(self, target: Target) -> ImpulseRange | None:
        """The impulses of the softest and the hardest stroke at a target; None if its instrument
        does not say how it is played.
        """
        acts = self.parts[target.part].acts
        striking_acts = [
            striking_act
            for striking_act in acts.values()
            if any(_module_of_name(path_name) == target.module for path_name in striking_act.at)
        ]
        named_acts = (
            striking_act
            for striking_act in striking_acts
            if striking_act.name == target.text.rpartition(".")[2]
        )
        act = next(named_acts, None) or next(iter([*striking_acts, *acts.values()]), None)
        return None if act is None else act.reach

    def ends_with_note(self, target: Target) -> bool:
        """Whether the end of a note does something where a target is struck."""
        return any(act.holds or act.is_drawn for act in self.parts[target.part].acts.values())

    def is_drawn(self, target: Target) -> bool:
        """Whether what a target strikes lasts as long as a note."""
        acts = self.parts[target.part].acts.values()
        return any(act.is_drawn for act in acts if target.module in map(_module_of_name, act.at))

    def drawn_act_names(self, instrument_name: Name, act: str) -> Iterator[Name]:
        """The name of an act of the instrument that a name names, if it has such an act, which
        lasts as long as a note.
        """
        owner = (
            instrument_name if instrument_name in self.parts else instrument_name.rpartition(".")[0]
        )
        part = self.parts.get(owner)
        if part is not None and act in part.acts and part.acts[act].is_drawn:
            yield Name(f"{owner}.{act}", instrument_name.place)

    def required_impulse_range(self, target: Target, label: str) -> ImpulseRange | None:
        """The impulses of the softest and the hardest stroke at a target; reports an instrument
        that does not say how it is played.
        """
        impulses = self.impulse_range(target)
        if impulses is None:
            message = f"{label}: how strongly? {quote(target.part)} has no `play` that says what "
            message += "soft and hard are; write an impulse with its unit, such as impulse: 2mNs"
            self.collector.error("E103", message, target.place)
        return impulses

    def _named_act(self, name: Name) -> tuple[PartContents, Act | None]:
        """The instrument and its act that a name names; no act if it names something else."""
        named_part = self.parts.get(name)
        if named_part is not None and named_part.acts:
            return named_part, next(iter(named_part.acts.values()))
        owner_path, _, path_tail = name.rpartition(".")
        named_part = self.parts.get(owner_path)
        if (
            named_part is not None
            and path_tail in named_part.acts
            and path_tail not in named_part.modules
        ):
            return named_part, named_part.acts[path_tail]
        return PartContents("", {}), None

    def member_names(self, name: Name, prefix: str = "") -> list[Name]:
        """The name itself; for an instrument with notes (`string`, `string.body.12`) one name for
        each note.
        """
        family_pair = self.family_and_rest(name, prefix)
        if family_pair is None:
            return [name]
        family, path_rest = family_pair
        names = (".".join(filter(None, (part, path_rest))) for part in family.parts.values())
        return [Name(word, name.place, str(name)) for word in names]

    def family_and_rest(self, path: str, prefix: str = "") -> tuple[NoteFamily, str] | None:
        """The notes of an instrument if a path names it without a note, and the rest of the path;
        else None.
        """
        for full_path in _with_prefix(tuning.spelled(path), prefix) if self.families else ():
            words = full_path.split(".")
            for n_words in range(len(words), 0, -1):
                family = self.families.get(".".join(words[:n_words]))
                is_note = n_words < len(words) and tuning.is_pitch(words[n_words])
                if family is not None and not is_note:
                    return family, ".".join(words[n_words:])
        return None

    def is_known(self, name: str) -> bool:
        """Whether a name is that of a key, an instrument, or a module of one."""
        return self._find(name, None, "") is not None

    def spelled(self, path: str, prefix: str = "") -> str:
        """A path with its note spelled as in the instrument: `string.Gb3` for `string.F#3`."""
        path = tuning.spelled(path)
        for full_path in _with_prefix(path, prefix) if self.families else ():
            words = full_path.split(".")
            for n_words in range(1, len(words)):
                family = self.families.get(".".join(words[:n_words]))
                part = None if family is None else family.note(words[n_words])
                if part is not None:
                    return ".".join((part, *words[n_words + 1 :]))
        return path

    def tuning_of(self, path: str) -> Tuning | None:
        """The tuning of the notes of what a path names: of its instrument, or of the score."""
        return tuning.tuning_of_path(path, self.tunings, self.tuning)

    def target(
        self,
        name: Name,
        wanted: WantedFamily,
        who: str,
        part: PartContents | None = None,
        prefix: str = "",
    ) -> Target | None:
        """The target of a name, seen from inside `part` if given; None if an error was reported.

        `mat`, `point` and `link` are single, `mats`, `points` and `links` may be several; a
        `body` is `mats`, where the name of a module alone means all its members. A point is in
        space, and each of its coordinates is a MAT: `ball.bob.x`.
        """
        members_match = _NAME_WITH_MEMBERS.fullmatch(name)
        prefix = prefix or (part.prefix if part else "")
        path = self.spelled(members_match[1] if members_match else str(name), prefix)
        named_target = self._find(path, part, prefix)
        members_text = members_match[2] if members_match else None
        axis_index = None
        if named_target is None and members_text is None:
            named_target, members_text = self._find_place(path, part, prefix)
        if named_target is None and members_match is not None and members_match[2] is None:
            named_target, members_text, axis_index = self._coordinate(path, part, prefix)
        if named_target is None and (family := self.family_and_rest(path, prefix)) is not None:
            parts = [*family[0].parts.values()]
            examples = ", ".join(parts[:4])
            problem = f"{quote(name)} has {len(parts)} notes; write one of them: {examples}"
            self._refuse(name, who, problem)
            return None
        if named_target is None:
            self._report_unknown(name, path, who, part)
            return None
        target_part, module_name = named_target
        self.referenced_parts.add(target_part.name)
        if module_name is None:
            module_name = self._only_module(target_part, name, wanted, who, members_text)
            if module_name is None:
                return None
        target_module = target_part.modules[module_name]
        if (target_module.kind in LINK_KINDS) != (wanted in ("link", "links")) or (
            target_module.kind not in LINK_KINDS and target_module.kind not in POINT_KINDS
        ):
            self._report_wrong_family(name, target_module, wanted, who)
            return None
        if target_part.axes > 1 and target_module.kind not in LINK_KINDS:
            return self._in_space(
                name, target_part, target_module, members_text, axis_index, wanted, who
            )
        if wanted in ("point", "points"):
            problem = f"{quote(name)} moves along one axis, not in space; to link one "
            problem += (
                "coordinate of a point to it, write the link in an instrument without `space`"
            )
            self._refuse(name, who, problem)
            return None
        return self._members(name, target_part, target_module, members_text, wanted, who)

    def _coordinate(
        self, path: str, seen_from: PartContents | None, prefix: str
    ) -> tuple[tuple[PartContents, str | None] | None, str | None, int | None]:
        """The part and module, the members, and the axis of a path that names a coordinate in
        space; None otherwise.
        """
        point_path, _, axis_name = path.rpartition(".")
        members_match = _NAME_WITH_MEMBERS.fullmatch(point_path)
        if axis_name not in AXES or members_match is None:
            return None, None, None
        coordinate_target = self._find(members_match[1], seen_from, prefix)
        if coordinate_target is None or coordinate_target[0].axes == 1:
            return None, None, None
        return coordinate_target, members_match[2], AXES.index(axis_name)

    def _in_space(
        self,
        name: Name,
        owner: PartContents,
        module: Module,
        members: str | None,
        axis: int | None,
        wanted: WantedFamily,
        who: str,
    ) -> Target | None:
        """Points of a module, or one of their coordinates; None if an error was reported."""
        masses = self._carrying_masses(owner, module)
        n_points = masses.count if masses else member_count(module.kind, module.fields)
        full_name = ".".join(filter(None, (owner.name, module.name)))
        first_point, n_named, problem = 0, 1, ""
        if n_points == 0:  # the body was refused already
            return None
        if members is None and n_points > 1:
            problem = (
                f"{full_name} has {n_points:,} points; write some of them: {full_name}.0, "
                f"{full_name}.all"
            )
        elif members is not None and n_points == 1:
            problem = f"{full_name} is one {module.kind}; it has no members"
        elif members is not None:
            try:
                start, n_named = parse_members(members, n_points, full_name)
                first_point = n_points // 2 if start == "centre" else start
            except TextError as error:
                problem = error.message
        is_point = wanted in ("point", "points")
        body_path = str(name) if axis is None else str(name).rpartition(".")[0]
        axis_names = AXES[: owner.axes]
        if problem:
            pass
        elif is_point and axis is not None:
            problem = f"{quote(name)} is one axis of a point; write the point: {body_path}"
        elif not is_point and axis is None:
            examples = ", ".join(f"{body_path}.{axis_name}" for axis_name in axis_names)
            problem = f"{quote(name)} is a point in space; write one of its axes: {examples}"
        elif axis is not None and axis >= owner.axes:
            problem = f"{owner.name} has the axes {' and '.join(axis_names)}"
        elif axis is not None and masses and axis == owner.axes - 1:
            full_path = ".".join(filter(None, (masses.part, masses.module)))
            problem = (
                f"{quote(name)} moves with a mass of {full_path}; write that mass, such as "
                f"{full_path}.0"
            )
        elif n_named > 1 and wanted in ("mat", "point"):
            problem = f"one is expected here, but {n_named:,} are named"
        if problem:
            self._refuse(name, who, problem)
            return None
        if is_point:
            return Target(
                owner.name, module.name, first_point, n_named, str(name), name.place, n_points
            )
        first_point += n_points * (axis or 0)
        return Target(owner.name, module.name, first_point, n_named, str(name), name.place)

    def _carrying_masses(self, owner: PartContents, module: Module) -> Target | None:
        """The masses that carry the points of a surface; None for other modules."""
        surface_of = module.fields["of"] if module.kind == "SURFACE" else None
        if not isinstance(surface_of, Name):
            return surface_of
        silent_names = replace(self, collector=Collector())
        missing_target = Target(owner.name, module.name, 0, 0, str(surface_of), surface_of.place)
        return silent_names.target(surface_of, "body", "", owner) or missing_target

    def _find_place(
        self, path: str, part: PartContents | None, prefix: str
    ) -> tuple[tuple[PartContents, str | None] | None, str | None]:
        """The part and its MODES, and the index of the place, for a path that names a place; None
        otherwise.
        """
        part_path, _, place_name = path.rpartition(".")
        place_target = self._find(part_path, part, prefix) if part_path else None
        if place_target is None:
            return None, None
        place_part, name = place_target
        bodies = [
            module
            for module_name, module in place_part.modules.items()
            if module.kind == "MODES" and name in (None, module_name)
        ]
        if len(bodies) != 1:
            return None, None
        modes_module = bodies[0]
        place_names = [place for place, _ in modes_module.fields["places"]]
        return (
            ((place_part, modes_module.name), str(place_names.index(place_name)))
            if place_name in place_names
            else (None, None)
        )

    def _find(
        self, path: str, seen_from: PartContents | None, prefix: str
    ) -> tuple[PartContents, str | None] | None:
        """The part and the module that a path names (module None: a part of several modules); None
        if there is none.
        """
        if seen_from is not None and path in seen_from.modules:
            return seen_from, path
        if seen_from is not None:
            first_name, _, path_rest = path.partition(".")
            if first_name in seen_from.self_names and (
                not path_rest or path_rest in seen_from.modules
            ):
                return seen_from, path_rest if path_rest or "" in seen_from.modules else None
        for full_path in _with_prefix(path, prefix):
            if full_path in self.parts:
                self.searched_parts.add(full_path)
                owner = self.parts[full_path]
                return owner, "" if "" in owner.modules else None
            first_name, _, path_rest = full_path.rpartition(".")
            if first_name in self.parts:
                self.searched_parts.add(first_name)
                if path_rest in self.parts[first_name].modules:
                    return self.parts[first_name], path_rest
        return None

    def _only_module(
        self,
        part: PartContents,
        name: Name,
        wanted: WantedFamily,
        label: str,
        members_text: str | None,
    ) -> str | None:
        if part.struck_mat:
            return part.struck_mat
        links = [
            module_name for module_name, module in part.modules.items() if module.kind in LINK_KINDS
        ]
        candidates = links if wanted in ("link", "links") else part.mats
        if part.refused_modules or not part.modules:  # refused already
            return None
        if len(candidates) == 1:
            return candidates[0]
        examples = ", ".join(f"{part.name}.{candidate}" for candidate in candidates[:4])
        if members_text is not None and examples:
            problem = f"{quote(part.name)} is made of named modules, which {quote(members_text)} "
            self._refuse(name, label, f"{problem}does not select; write a list: [{examples}]")
            return None
        word, count = quote(name.written), len(candidates)
        problem = f"{word} is ambiguous: it has {count} modules of this kind"
        if examples:
            problem += f"; write one of them: {examples}"
        self._refuse(name, label, problem)
        return None

    def _members(
        self,
        name: Name,
        owner: PartContents,
        module: Module,
        members: str | None,
        wanted: WantedFamily,
        who: str,
    ) -> Target | None:
        count = self._member_count(owner, module)
        allows_several = wanted in ("mats", "body", "links")
        full_name = ".".join(filter(None, (owner.name, module.name)))
        first_member: int | Literal["centre"] = 0
        n_named = 1
        problem = ""
        if members is None:
            if module.kind in LINK_KINDS or wanted == "body":  # all together
                n_named = count
            elif count > 1:
                member_kind, examples = "masses", ("0", "centre")
                if module.kind == "MODES":
                    member_kind, examples = (
                        "places",
                        tuple(place_name for place_name, _ in module.fields["places"])[:4],
                    )
                words = ", ".join(f"{full_name}.{example}" for example in examples)
                problem = f"{full_name} has {count:,} {member_kind}; write one of them: {words}"
        elif count == 1 and module.kind in (*LINK_KINDS, "MAS", "SOL", "CEL", "PROXY"):
            problem = f"{full_name} is one {module.kind}; it has no members"
        else:
            try:
                first_member, n_named = parse_members(members, count, full_name)
            except TextError as error:
                problem = error.message
        if not problem and n_named > 1 and not allows_several:
            problem = f"one MAT is expected here, but {n_named:,} are named"
        if problem:
            self._refuse(name, who, problem)
            return None
        return Target(owner.name, module.name, first_member, n_named, str(name), name.place)

    def _member_count(self, owner: PartContents, module: Module) -> int:
        """The number of members of a module, or of single links of a link over a range."""
        if module.kind not in LINK_KINDS:
            return member_count(module.kind, module.fields)
        silent_names = replace(self, collector=Collector())
        ends = module.fields["between"] or ()
        wanted: WantedFamily = "points" if owner.axes > 1 else "mats"
        targets = (silent_names.target(end, wanted, "", owner) for end in ends)
        return n_links([end for end in targets if end is not None])

    def _report_unknown(self, name: Name, path: str, who: str, part: PartContents | None) -> None:
        if self._is_broken(path, part):
            return
        instrument, _, path_rest = name.written.rpartition(".")
        family = self.family_and_rest(instrument) if instrument else None
        near_note = None if family is None or tuning.is_pitch(path_rest) else note_slip(path_rest)
        if near_note is not None:
            suggestion = near_note.suggestion and f"{instrument}.{near_note.suggestion}"
            self._refuse(name, who, near_note.message, "E201", suggestion=suggestion)
            return
        known_names = list(part.modules) if part else []
        known_names += list(self.parts)
        if "." in path and (owner_path := path.rpartition(".")[0]) in self.parts:
            written = name.written.rpartition(".")[0] if name.written != name else owner_path
            known_names = [
                f"{written}.{module_name}"
                for module_name in _inside(self.parts[owner_path].modules.values())
            ]
        near_names = [
            known for known in known_names if known
        ]  # a lone generator's module has no name
        problem = f"nothing is called {quote(name.written)}"
        if family is not None:
            notes = [full_name.rpartition(".")[2] for full_name in family[0].parts.values()]
            problem += f"; the notes of {quote(instrument)} are {notes[0]} to {notes[-1]}"
        self._refuse(name, who, problem, "E301", word=name.written, names=near_names)

    def _refuse(self, name: Name, who: str, problem: str, code: str = "E304", **more: Any) -> None:
        """Report what is wrong with a name; `who` says whose name it is, or is empty."""
        message = f"{who}: {problem}" if who else problem
        self.collector.error(code, message, name.place, **more)

    def _is_broken(self, path: str, seen_from: PartContents | None) -> bool:
        """Whether the name was refused already: each mistake is reported once."""
        words = path.split(".")
        splits = [
            (".".join(words[:word_count]), ".".join(words[word_count:]))
            for word_count in range(1, len(words) + 1)
        ]
        for (
            part_path,
            path_rest,
        ) in splits:  # a part, a module of the same part, or a module of another
            if part_path in self.refused_parts or (
                seen_from is not None and part_path in seen_from.refused_modules
            ):
                return True
            owner = self.parts.get(part_path)
            if owner is not None and (
                not owner.modules or path_rest.split(".")[0] in owner.refused_modules
            ):
                return True
        return False

    def _report_wrong_family(
        self, name: Name, module: Module, wanted: WantedFamily, label: str
    ) -> None:
        if wanted in ("link", "links"):
            message = f"{quote(name)} is a {module.kind}: SOF listens to the force of a link"
        elif module.kind in LINK_KINDS:
            message = (
                f"{quote(name)} is a {module.kind}, a link: an <L> point joins <M> points only"
            )
        else:
            message = f"{quote(name)} is a {module.kind}: it has no <M> point of its own"
        self._refuse(name, label, message)


def _play_label(owner: PartContents) -> str:
    return f"play of {quote(owner.name)}"


def _with_act_modules(modules: Mapping[str, Module], act: Act) -> Mapping[str, Module]:
    """Modules with those of an act that are not among them."""
    added_modules = {module.name: module for module in act.modules if module.name not in modules}
    return {**modules, **added_modules} if added_modules else modules


def _module_of_name(name: str) -> str:
    """The module of a name inside an instrument."""
    return name.partition(".")[0]


def _inside(modules: Iterable[Module]) -> Iterator[str]:
    """Names of modules and of their places, as written after the name of their part."""
    for part_module in modules:
        if part_module.name:
            yield part_module.name
        for place, _ in part_module.fields["places"] if part_module.kind == "MODES" else ():
            yield ".".join(filter(None, (part_module.name, place)))


def _with_prefix(path: str, prefix: str) -> tuple[str, ...]:
    """The full names that a path may mean: first with the prefix of its file, then without."""
    return (f"{prefix}.{path}", path) if prefix else (path,)
