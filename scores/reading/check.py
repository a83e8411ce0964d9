"""Checks a score as a whole: every name is known, every instant exists, every rule is kept."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import accumulate, chain
from typing import Any

from ergon.common.changed import changed_part
from ergon.instruments import rules, spread
from ergon.instruments.model import PRESS, Instrument, Target
from ergon.instruments.names import PartNames
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Name
from ergon.notation.text.errors import quote
from ergon.notation.text.memory import Memory
from ergon.scores.reading import build, build_mix, melodies, phrase_do, rhythm_strikes
from ergon.scores.reading.above_rate import without_modes_above
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.automation_targets import AutomationTargets
from ergon.scores.reading.gestures_and_takes import GesturesAndTakes
from ergon.scores.reading.include import MAX_INCLUDED, Include, IncludedPlay, included_play
from ergon.scores.reading.known_entries import KnownEntries
from ergon.scores.reading.known_plays import KnownPlays
from ergon.scores.reading.matter import PartsReader
from ergon.scores.reading.note_targets import NoteTargets
from ergon.scores.reading.piece import Hit, Piece, Strikes
from ergon.scores.reading.playing import Coupling, Play, Player
from ergon.scores.reading.routing import routed_mix
from ergon.scores.reading.schedule import start_beats
from ergon.scores.reading.struck_tuning import strikes_tuning
from ergon.scores.reading.times import Times
from ergon.scores.reading.uses import Names, Uses
from ergon.scores.reading.wheels import with_wheels


class Checker:
    """Builds the piece of one score whose names were read, and reports all mistakes."""

    def __init__(self, names: Names, uses: Uses) -> None:
        """Take what was read."""
        assert names.score is not None
        self.names = names
        self.uses = uses
        self.score = names.score
        self.collector = uses.collector
        self.part_names = PartNames(self.collector, tuning=names.tuning)
        self.gestures_and_takes = GesturesAndTakes(names, uses)
        self.parts = PartsReader(names, uses, self.part_names, self.gestures_and_takes)
        self._phrases_by_name: dict[str, Values | None] | None = None

    def build_piece(self) -> Piece:
        """The whole piece; its values are valid only if no error was reported."""
        score = self.score
        if not score.written("ergon"):
            message = "the format version is missing; write `ergon: 1` in the first line"
            score.error("W101", message)
        memory, score_file = self.uses.files.memory, score.node.document.file
        times = Times(score, self.collector, memory, self.uses.midi_uses)
        self._has_quarters = times.tempo_map.bars.has_quarters
        self.gestures_and_takes.has_quarters = self._has_quarters
        self.gestures_and_takes.add_defined(score.place)
        self.parts.read()
        strikes = KnownEntries(memory, "strikes", score_file).read(
            score["strikes"] or (),
            self._strikes,
            self._struck_modules,
            self.part_names,
            self.parts.by_name.get,
        )
        players = {v.context.name: self._player(v) for v in self._section_values("players")}
        written_mix = build_mix.mix(score["mix"], self.uses.files)
        mix = routed_mix(written_mix, self.parts.by_name, self.part_names)
        duet = [c for i, v in enumerate(score["duet"] or ()) if (c := self._coupling(v, i))]
        self._reference_automated_parts(memory, score_file)
        included = self._included(times, len(duet))
        for entry in chain(strikes, *(included_piece.strikes for _, included_piece in included)):
            for target in entry.to:
                self.part_names.add_modules_of_struck(target)
        self.parts.resolve_reached_parts()
        automation_targets = AutomationTargets(self.parts, self.part_names, self.uses.midi_uses)
        for entry in strikes:
            automation_targets.check_glides(entry)
        part_plays = self._plays(times.known_plays)
        automation_changes = KnownEntries(memory, "automation", score_file).read(
            self.score["automation"] or (),
            automation_targets.read,
            automation_targets.modules,
            self.part_names,
            self.parts.by_name.get,
        )
        for _, included_piece in included:
            part_plays = *part_plays, *included_piece.parts
            strikes += included_piece.strikes
            automation_changes += included_piece.automation
            duet += included_piece.duet
            players |= included_piece.players
        piece = Piece(
            title=score["title"],
            seed=score["seed"],
            rate=self.parts.rate,
            motion=self.parts.motion,
            tempo=times.entries,
            marks=times.marks,
            keys=self.parts.keys,
            instruments=self._computed_instruments(strikes, automation_changes, duet, memory),
            gestures=self.gestures_and_takes.gestures,
            takes=self.gestures_and_takes.takes,
            strikes=strikes,
            players=players,
            duet=tuple(duet),
            parts=part_plays,
            mix=mix,
            render=build_mix.render(score["render"], self.uses.files),
            accuracy=build_mix.accuracy(score["accuracy"]),
            place=score.place,
            tempo_map=times.tempo_map,
            automation=automation_changes,
            blocks={n: text for n, text in (score["blocks"] or {}).items() if text is not MISSING},
            phrases=tuple(self._phrases()),
            available=self._unplayed_instruments(),
            file_meters=times.file_times.meters,
            used=tuple(self.names.families),
            tuning=self.names.tuning,
            tunings=self.part_names.tunings,
            families={n: (*notes.parts.values(),) for n, notes in self.part_names.families.items()},
        )
        begins = times.check_piece(score, piece)
        if self.collector.has_errors():
            return piece
        return replace(piece, starts=start_beats(piece, begins, times.known_plays, self.collector))

    def _computed_instruments(
        self,
        strikes: Iterable[Strikes],
        changes: Iterable[Automation],
        duet: Iterable[Coupling],
        memory: Memory | None,
    ) -> dict[str, Instrument]:
        """The instruments of the piece, without modes that no rate of the piece computes."""
        notes, entries = self.part_names.families, self.names.tables["instruments"].items()
        reported_name_by_part = {
            part: name for name, family in notes.items() for part in family.parts.values()
        }
        derived_values = {
            name: entry.values
            for name, entry in entries
            if isinstance(entry.values, Values) and entry.values.written("like", "from")
        }
        reported_name_by_part = {**{name: name for name in derived_values}, **reported_name_by_part}

        def used_modules() -> Iterator[tuple[str, str]]:
            for name, values in derived_values.items():
                yield from ((name, module) for module in values["modules"] or ())
            struck_targets = (target for line in strikes for target in line.to)
            end_targets = (end for coupling in duet for end in (coupling.a, coupling.b))
            yield from (
                (target.part, target.module) for target in chain(struck_targets, end_targets)
            )
            yield from (module_line for line in changes for module_line in line.modules)

        parts, rate = self.parts.instruments, self.parts.rate
        return without_modes_above(
            parts, reported_name_by_part, used_modules(), rate, self.collector, memory
        )

    def _unplayed_instruments(self) -> dict[str, Instrument]:
        """Instruments that a file brings and nothing plays, or the first note of one with notes;
        names in them are not looked up.
        """
        unplayed = {}
        for instrument_name in self.names.tables["instruments"]:
            family = self.part_names.families.get(instrument_name)
            first_part = (
                instrument_name
                if family is None
                else next(iter(family.parts.values()), instrument_name)
            )
            instrument = self.parts.by_name.get(first_part)
            if isinstance(instrument, Instrument) and first_part not in self.parts.instruments:
                unplayed[instrument_name] = instrument
        return unplayed

    # --- what other scores play ------------------------------------------------------------------

    def _included(self, times: Times, n_links: int) -> list[tuple[Include, IncludedPlay]]:
        """The lines of `include:` with what their scores play."""
        included: list[tuple[Include, IncludedPlay]] = []
        if self.uses.is_full or not self.names.included:
            return included
        n_lines = 0
        taken_names = {
            section_values.context.name: None for section_values in self._section_values("strikes")
        }
        player_by_name: dict[str, Player | None] = {
            section_values.context.name: None for section_values in self._section_values("players")
        }
        for include_entry, file_names in self.names.included:
            if not times.exists(include_entry.at, include_entry.values.place_of("at")):
                continue
            file_name = file_names.document.file
            if file_name not in self.uses.pieces:
                with tuning.used(file_names.tuning):
                    self.uses.pieces[file_name] = Checker(file_names, self.uses).build_piece()
            piece = self.uses.pieces[file_name]
            if self.collector.has_errors():
                continue
            played_include = included_play(piece, include_entry, n_links, self.collector)
            n_links += len(played_include.duet)
            n_lines += len(played_include)
            if n_lines > MAX_INCLUDED:
                message = f"more than {MAX_INCLUDED:,} lines are included"
                self.collector.error("E105", message, include_entry.place)
                break
            clashes = [
                f"strikes {quote(strikes_entry.name)}"
                for strikes_entry in played_include.strikes
                if strikes_entry.name in taken_names
            ]
            clashes += [
                f"player {quote(name)}"
                for name, player in played_include.players.items()
                if player_by_name.get(name, player) != player
            ]
            for clash in clashes:
                message = f"{clash} of {file_name} is already defined; give its names a prefix"
                self.collector.error(
                    "E303", message, include_entry.place, help="include: {file: x, as: v2}"
                )
            taken_names |= {strikes_entry.name: None for strikes_entry in played_include.strikes}
            player_by_name |= played_include.players
            self._reference_included(piece, include_entry.prefix)
            included.append((include_entry, played_include))
        return included

    def _reference_included(self, piece: Piece, prefix: str) -> None:
        name_prefix = f"{prefix}." if prefix else ""
        self.part_names.referenced_parts |= {
            name_prefix + name for name in (*piece.keys, *piece.instruments)
        }
        for name in (*piece.gestures, *piece.takes):
            self.gestures_and_takes.make(name_prefix + name)

    def _section_values(self, section: str) -> list[Values]:
        return [v for v in (self.score[section] or {}).values() if isinstance(v, Values)]

    # --- who plays what, and where it goes ------------------------------------------------------

    def _player(self, player_values: Values) -> Player:
        player = build.player(player_values)
        key_label = player_values.context.label("key")
        keys = self.names.tables["keys"]
        if player.key not in keys:
            message = f"{key_label}: no key is called {quote(player.key)}"
            player_values.error("E301", message, "key", word=player.key, names=tuple(keys))
        self.part_names.referenced_parts.add(player.key)
        if isinstance(player.standin, Name):
            self.gestures_and_takes.make_named(
                player.standin, player_values.context.label("standin")
            )
        return player

    def _plays(self, known_plays: KnownPlays) -> tuple[Play, ...]:
        """The lines of all parts; what they play is made."""
        section = self.score.nodes.get("parts")
        entries = getattr(section, "entries", {})
        parts_by_player = self.score["parts"] or {}
        part_plays, names_by_part = known_plays.plays(parts_by_player)
        first_play = 0
        for player_name, part_rows in parts_by_player.items():
            if player_name not in (self.score["players"] or {}):
                message = f"no player is called {quote(player_name)}"
                place = entries[player_name][0].place
                player_names = tuple(self.score["players"] or {})
                self.collector.error("E301", message, place, word=player_name, names=player_names)
            part_label = f"part of {quote(player_name)}"
            unknown_names = {
                word
                for word in names_by_part.get(player_name, ())
                if not self._can_play(word, part_label)
            }
            n_plays = 0 if part_rows is MISSING else len(part_rows)
            for play in part_plays[first_play : first_play + n_plays] if unknown_names else ():
                for played_word in play.names:
                    if played_word in unknown_names and not any(
                        played_word is unknown_word for unknown_word in unknown_names
                    ):
                        self._can_play(played_word, part_label)
            first_play += n_plays
        return part_plays

    def _can_play(self, word: str, label: str) -> bool:
        """Make what a line plays; False if an error was reported. A rest is not made."""
        return not isinstance(word, Name) or self.gestures_and_takes.make_named(word, label)

    def _strikes(self, values: Any) -> Strikes | None:
        if not isinstance(values, Values) or not melodies.has_required_fields(values):
            return None
        phrase = self._phrases().get(values["play"]) if values.written("play") else None
        tuning_context = strikes_tuning(values, phrase, self.part_names)
        if tuning_context is None:
            return None
        with tuning_context:
            return self._strikes_by_kind(values)

    def _strikes_by_kind(self, strike_values: Values) -> Strikes | None:
        strikes_kind = melodies.kind_of(strike_values)
        if strikes_kind in melodies.MELODY_KINDS:
            phrases = self._phrases()
            phrase = phrases.get(strike_values["play"]) if strikes_kind == "play" else None
            take = phrase if isinstance(phrase, Values) and melodies.has_note_file(phrase) else None
            if take is not None:
                self.uses.midi_uses.register_played(take, has_lengths=True)
            phrase_hits = melodies.hits_of(strike_values, self.part_names, phrases, self.uses.files)
            if (
                phrase_hits is not None
                and take is not None
                and self._has_pressure_act(phrase_hits[0])
            ):
                self.uses.midi_uses.register_pressures(take)
            if phrase_hits is not None and not self._has_quarters and isinstance(phrase, Values):
                phrase_hits = melodies.in_quarter_notes(phrase, *phrase_hits)
            if phrase_hits is None:
                return None
            melody = self._melody(build.melody(strike_values, *phrase_hits), strike_values)
            if melody is None or take is None:
                return melody
            return with_wheels(melody, strike_values, take, self.uses.files)
        if strikes_kind == "rhythm":
            return rhythm_strikes.strikes_of_rhythm(strike_values, self.part_names)
        strikes_label = f"strikes {quote(strike_values.context.name)}"
        target_names = strike_values["to"] or ()
        if strike_values["along"] is not None and not strikes_kind:
            return self._strikes_along_direction(strike_values, target_names, strikes_label)
        targets_by_name = [
            self.part_names.struck_targets(name, strikes_label) for name in target_names
        ]
        if not all(targets_by_name):
            return None
        strike_targets = tuple(chain.from_iterable(targets_by_name))
        for strike_target in strike_targets:
            if (
                self.part_names.parts[strike_target.part].modules[strike_target.module].kind
                == "PROXY"
            ):
                message = (
                    f"{strikes_label}: {quote(strike_target.text)} is a PROXY, which has no mass; "
                )
                message += "strike the masses that it lies between"
                self.collector.error("E304", message, strike_target.place)
                return None
        if strikes_kind:
            passing = build.passing_strikes(strike_values, strike_targets)
            for strike_target in (
                strike_targets if passing.passing and passing.passing.is_by_pitch else ()
            ):
                self._check_pitched_members(strike_target, strikes_label)
            return self._with_impulse_ranges(passing, strike_values)
        n_reports = self.collector.n_reports
        strikes_built = self._with_impulse_ranges(
            build.strikes(strike_values, strike_targets), strike_values
        )
        if strikes_built is None:
            return None
        if (
            strikes_built.notes
            and target_names
            and all(self.part_names.family_and_rest(name) for name in target_names)
        ):
            note_targets = NoteTargets(self.part_names, target_names)
            strikes_built = melodies.strikes_of_pattern(
                strikes_built, strike_values, note_targets, strikes_label
            )
        if strike_values.written("do") and self.collector.n_reports == n_reports:
            transforms = phrase_do.rhythm_transforms(strike_values)
            if transforms is None:
                return None
            return rhythm_strikes.transformed_strikes(
                strikes_built, transforms, strike_values, self.part_names, target_names
            )
        if strikes_built.voices:
            return strikes_built
        for strike_target in strikes_built.to if strikes_built.notes else ():
            self._check_has_pitch(strike_target, strikes_label)
        return strikes_built

    def _has_pressure_act(self, hits: Iterable[Hit]) -> bool:
        """Whether the pressure on keys plays what is struck."""
        struck_parts = {target.part for hit in hits for target in hit.to}
        return any(PRESS in self.part_names.parts[part].acts for part in struck_parts)

    def _melody(self, strikes: Strikes, values: Values) -> Strikes | None:
        """A melody, or a phrase as a rhythm where it has transformations of rhythms; None if an
        error was reported.
        """
        if melodies.kind_of(values) != "play":
            return strikes
        phrase_transforms = phrase_do.phrase_transforms(values)
        phrase = self._phrases()[values["play"]]
        if phrase is None or phrase_transforms is None or not phrase_transforms[1]:
            return strikes
        names = melodies.notes_in(phrase, values)
        return rhythm_strikes.transformed_strikes(
            strikes, phrase_transforms[1], values, self.part_names, names
        )

    def _with_impulse_ranges(self, strikes: Strikes, strike_values: Values) -> Strikes | None:
        """Strikes with the reaches of what they strike, if they have strengths; None if an error
        was reported.
        """
        strike_levels, error_label = strikes.levels, f"strikes {quote(strikes.name)}"
        if strike_levels is None or not strike_levels.has_strengths:
            return strikes
        range_by_part = {}
        for strike_target in strikes.to:
            impulse_range = self.part_names.required_impulse_range(strike_target, error_label)
            if impulse_range is None:
                return None
            range_by_part[strike_target.part] = impulse_range
        if strikes.rate is not None and any(map(self.part_names.is_drawn, strikes.to)):
            message = (
                f"{strike_values.context.label('rate')}: a bow is drawn for as long as a note; "
                "write "
            )
            strike_values.error("E111", message + "`every`, with `chance` if need be", "rate")
            return None
        if strikes.rate is not None and (
            len(strike_levels.steps) > 1 or len({*range_by_part.values()}) > 1
        ):
            message = (
                f"{strike_values.context.label('rate')}: strikes by chance have one impulse; write "
                "an "
            )
            strike_values.error(
                "E111", message + "entry for each instrument and each strength", "rate"
            )
            return None
        return replace(strikes, impulse_ranges=range_by_part)

    def _strikes_along_direction(
        self, strike_values: Values, target_names: Sequence[Name], strikes_label: str
    ) -> Strikes | None:
        """Strikes on points along a direction: each coordinate gets its share; None if an error was
        reported.
        """
        direction = strike_values["along"]
        direction_length = math.hypot(*direction)
        if direction_length == 0.0:
            message = (
                f"{strike_values.context.label('along')}: it has no direction; write one number "
                "above 0"
            )
            strike_values.error("E105", message, "along")
            return None
        if contrary_fields := strike_values.written("mass", "speed", "notes"):
            message = (
                f"{strike_values.context.label(contrary_fields[0])}: strikes along a direction "
                "have an `impulse`"
            )
            strike_values.error("E111", f"{message} alone", contrary_fields[0])
            return None
        coordinate_targets = [
            point_target
            for name in target_names
            for point_target in self.part_names.targets(name, "points", strikes_label)
        ]
        for strike_target in coordinate_targets:
            axes = self.part_names.parts[strike_target.part].axes
            if axes != len(direction):
                message = (
                    f"{strike_values.context.label('along')}: {quote(strike_target.text)} has "
                    f"{axes} axes, not "
                )
                strike_values.error("E106", f"{message}{len(direction)}", "along")
                return None
            if (
                self.part_names.parts[strike_target.part].modules[strike_target.module].kind
                == "SURFACE"
            ):
                message = (
                    f"{strikes_label}: {quote(strike_target.text)} moves along one axis; strike "
                    "its masses"
                )
                self.collector.error("E304", message, strike_target.place)
                return None
        strikes_built = build.strikes(strike_values, tuple(coordinate_targets))
        if strikes_built.levels is not None and strikes_built.levels.has_strengths:
            message = (
                f"{strike_values.context.label('along')}: strikes along a direction have an "
                "impulse, "
            )
            strike_values.error("E103", message + "such as impulse: 2mNs", "along")
            return None
        coordinate_points = tuple(
            replace(point, first=int(point.first) + axis * point.points, points=0)
            for axis in range(len(direction))
            for point in coordinate_targets
        )
        return replace(
            strikes_built,
            to=coordinate_points,
            along=tuple(part / direction_length for part in direction),
        )

    def _phrases(self) -> dict[str, Values | None]:
        """Phrases, and takes that are MIDI files."""
        if self._phrases_by_name is None:
            tables = self.names.tables
            takes = {
                take_name: take_entry.values
                for take_name, take_entry in tables["takes"].items()
                if melodies.has_note_file(take_entry.values)
            }
            entries = tables["phrases"].items()
            phrases = {name: self.uses.resolved("phrases", entry)[0] for name, entry in entries}
            self._phrases_by_name = {**takes, **phrases}
        return self._phrases_by_name

    def _check_has_pitch(self, strike_target: Target, strikes_label: str) -> None:
        """Report a target that is not one CEL with values in SI units."""
        target_part = self.part_names.parts[strike_target.part]
        struck_part = self.parts.by_name[strike_target.part]
        is_ca = isinstance(struck_part, Instrument) and struck_part.ca_rate is not None
        if target_part.modules[strike_target.module].kind != "CEL" or is_ca:
            message = (
                f"{strikes_label}: {quote(strike_target.text)} has no pitch of its own; notes are "
                "for CELs"
            )
            is_tuned = isinstance(struck_part, Instrument) and struck_part.pitch is not None
            advice = "`notes` gives an instrument a member for each: notes: [C4, D4] in a score, "
            advice += (
                f"{strike_target.part}-notes = {strike_target.part} notes=C4..D5 at the prompt"
            )
            self.collector.error(
                "E304", message, strike_target.place, help=advice if is_tuned else None
            )

    def _check_pitched_members(self, strike_target: Target, strikes_label: str) -> None:
        """Report a target whose members have no pitch each."""
        if self.part_names.parts[strike_target.part].modules[strike_target.module].kind not in (
            "CEL",
            "BANK",
        ):
            message = (
                f"{strikes_label}: members of {quote(strike_target.text)} have no pitch each, as "
                "those of a BANK "
            )
            message += "have; choose a sweep that needs no pitch: outward or rightward"
            self.collector.error("E304", message, strike_target.place)

    def _reference_automated_parts(self, memory: Memory | None, file_name: str) -> None:
        """Mark the parts that automation changes as reached: they belong to the piece."""
        automation_section = self.score["automation"] or ()
        remembered_section = None if memory is None else memory.held(f"led {file_name}", None)
        automation_before, path_counts, path_prefixes = remembered_section or (
            (),
            Counter[str](),
            frozenset(),
        )
        if changed_range := changed_part(automation_before, automation_section):
            path_counts = path_counts.copy()
            path_counts.subtract(map(_automated_path, changed_range.before))
            path_counts.update(map(_automated_path, changed_range.now))
            path_counts = +path_counts
            path_prefixes = {
                part for name in path_counts for part in accumulate(name.split("."), _joined_path)
            }
        if memory is not None:
            memory.hold(f"led {file_name}", None, (automation_section, path_counts, path_prefixes))
        self.part_names.referenced_parts |= path_prefixes & self.parts.by_name.keys()

    def _struck_modules(
        self, strikes: Strikes, strike_values: Values
    ) -> tuple[tuple[str, str], ...] | None:
        """The modules on which strikes depend; None for those that depend on more."""
        names = strike_values["to"] or ()
        if melodies.kind_of(strike_values) or any(
            self.part_names.family_and_rest(name) for name in names
        ):
            return None
        return tuple({(target.part, target.module) for target in strikes.to})

    def _coupling(self, values: Any, number: int) -> Coupling | None:
        coupling_built = build.coupling(values, number) if isinstance(values, Values) else None
        if coupling_built is None:
            return None
        keys = self.names.tables["keys"]
        end_targets = []
        for coupled_name in values["couple"]:
            if coupled_name not in keys:
                message = f"coupling: no key is called {quote(coupled_name)}"
                self.collector.error(
                    "E301", message, coupled_name.place, word=coupled_name, names=tuple(keys)
                )
                return None
            end_targets.append(self.part_names.target(coupled_name, "mat", "coupling"))
        first_key, second_key = end_targets
        if first_key is None or second_key is None:
            return None
        if (first_key.part, first_key.module) == (second_key.part, second_key.module):
            message = "coupling: a key cannot be coupled with itself; name two keys"
            self.collector.error("E304", message, second_key.place)
        if coupling_built.link.fields.get("follows"):
            message = "coupling: what follows a MAT stands in an instrument; link the keys there"
            self.collector.error("E304", message, coupling_built.place)
            return None
        laws = self.parts.laws((coupling_built.link,), self.names)
        coupling_label = f"{coupling_built.link.kind} of a coupling"
        coupling_link = rules.with_checked_law(
            coupling_built.link, laws, values.by_name[values.kind], coupling_label, self.collector
        )
        if "gap" in coupling_link.fields:
            gap = spread.contact_gaps(coupling_link, 1, coupling_label, self.collector)
            coupling_link = replace(coupling_link, fields={**coupling_link.fields, "gap": gap})
        return replace(coupling_built, link=coupling_link, a=first_key, b=second_key)


def _automated_path(values: Any) -> str:
    """The parameter that an entry of automation changes, as written."""
    return str(values["set"] or values["lfo"] or "") if isinstance(values, Values) else ""


def _joined_path(prefix: str, word: str) -> str:
    return f"{prefix}.{word}"
