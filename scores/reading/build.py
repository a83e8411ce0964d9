"""Makes what moves and plays in a piece from the values that were read, and checks their fields
together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from ergon.common.foreign_files import foreign_form
from ergon.instruments.model import Module, Target
from ergon.instruments.read import make_module
from ergon.instruments.read import read_modules as read_modules
from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import parse_with_names
from ergon.notation.tables.strengths import MEZZO_FORTE, Levels
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.document import Scalar
from ergon.notation.text.errors import TextError
from ergon.notation.text.files import Files
from ergon.scores.gesture import notation, note_files, space_path, take_file
from ergon.scores.pattern.order import Group, single_name_pattern
from ergon.scores.pattern.values import Amount, parse_values
from ergon.scores.reading import calibration
from ergon.scores.reading.automatable import amount_reader
from ergon.scores.reading.gesture_tables import OSC
from ergon.scores.reading.patterns import PATTERN_FIELDS, PatternValues, pattern_of
from ergon.scores.reading.piece import Hit, Strikes, TempoEntry
from ergon.scores.reading.playing import Coupling, Gesture, Key, Player, SoundInput, TakeFile
from ergon.scores.reading.playing_options import OptionValues, playing_options
from ergon.scores.reading.sweep_fields import read_passing

BEGINNING = Position()


def has_single(values: Values, *groups: tuple[str, ...]) -> bool:
    """Whether fields of exactly one group are written; reports two, or none."""
    written_groups = [group for group in groups if values.written(*group)]
    if len(written_groups) > 1:
        first_field, surplus_field = (
            values.written(*written_groups[0])[0],
            values.written(*written_groups[1])[0],
        )
        values.error(
            "E111",
            f"{values.context.label(surplus_field)}: {first_field} is written too; keep one of "
            "the two",
            surplus_field,
        )
    elif not written_groups:
        alternatives = " or ".join(group[0] for group in groups)
        values.error("E103", f"{values.context.label('')} needs {alternatives}")
    return len(written_groups) == 1


def key(values: Values, files: Files) -> Key:
    """A key; `calib:` supplies what is not written here."""
    calibration_values = calibration.measured_values(values, files)
    if calibration_values is not None:
        values = calibration.with_measured_fields(values, calibration_values)
    cell_fields = ("M", "K", "Z", "f", "t60")
    modules: tuple[Module, ...] = ()
    if values.written("modules"):
        if refused_fields := values.written(*cell_fields):
            message = (
                f"{values.context.label(refused_fields[0])}: `modules` is written too; "
                "keep one of the two"
            )
            values.error("E111", message, refused_fields[0])
        if not values.written("struck"):
            message = (
                f"{values.context.label('')} has no `struck`; write the module that ergons strike"
            )
            values.error("E103", message)
        modules = read_modules(values)
    else:
        if not values.written("M"):
            values.error("E103", f"{values.context.label('')} has no 'M': its mass, such as 400g")
        has_single(values, ("K", "Z"), ("f", "t60"))
        fields = {name: values[name] for name in (*cell_fields, "rest", "X0", "V0")}
        place_by_field = {name: node.place for name, node in values.nodes.items()}
        modules = (Module("", "CEL", fields, values.place, place_by_field),)
        if calibration_values is not None and not values["simple"]:
            travel_end = calibration.resting_end(values, calibration_values)
            modules = calibration.key_modules(modules[0], calibration_values, travel_end)
    travel_range = values["travel"]
    if travel_range is not None and not travel_range[0] <= values["X0"] <= travel_range[1]:
        message = f"{values.context.label('X0')}: the key begins outside its travel"
        values.error("E202", message, "X0")
    struck_module = values["struck"] or ""
    key_constants = (
        None if calibration_values is None else calibration.key_constants(calibration_values)
    )
    delay = values["delay"]
    if delay is None and key_constants is not None and not values["simple"]:
        delay = key_constants[2]
    if key_constants is not None:
        key_constants = *key_constants[:2], delay
    key_fields = (
        values.context.name,
        modules,
        struck_module,
        travel_range,
        values["reach"],
        values.place,
    )
    return Key(*key_fields, measured_constants=key_constants, delay=delay or 0.0)


def gestures(values: Values, n_points_max: int = notation.MAX_EVENTS) -> dict[str, Gesture] | None:
    """Gestures with at most `n_points_max` points: one by the name "", or one for each axis of a
    path in space.

    None if an error was reported.
    """
    if not has_single(values, ("notation",), ("points",)):
        return None
    notation_field = values.written("notation", "points")[0]
    notation_text = values.by_name.get(notation_field)
    if not isinstance(notation_text, Scalar):
        return None

    def parse(source: str) -> tuple[notation.Notation, ...]:
        if notation_field == "notation" and space_path.axis_count(source) > 1:
            return space_path.parse(source, values["curve"], n_points_max)
        parse_axis = notation.parse if notation_field == "notation" else notation.parse_table
        return (parse_axis(source, values["curve"], n_points_max),)

    try:
        notations = parse_with_names(
            notation_text,
            lambda gesture_text: [
                _moved_to_start(gesture, gesture_text, notation_text)
                for gesture in parse(gesture_text)
            ],
        )
    except TextError as error:
        values.context.text_error(error, notation_text, "")
        return None
    options_of_playing = playing_options(cast("OptionValues", values.by_name))
    options = values["do"] or (), options_of_playing, values.place, notation_text
    axis_gestures = [
        Gesture(values.context.name, gesture.points, gesture.bar_checks, *options)
        for gesture in notations
    ]
    return (
        {"": axis_gestures[0]}
        if len(axis_gestures) == 1
        else dict(zip(AXES, axis_gestures, strict=False))
    )


_INPUT_HIGHPASS_HZ = 20.0  # of an input [Hz]
_INPUT_GLIDE_SECONDS = 0.02  # from one value by OSC to the next [s]
_INPUT_GLIDE_SECONDS_MAX = 60.0  # [s]
_INPUT_NAMES = ("gain", "highpass", "clamp", "glide")
_MIDI_NAMES = ("velocity", "depth", "curve")
_REFUSED_INPUT_FIELDS = (*_MIDI_NAMES, "trim", "smooth", "rate", "unit")


def take(values: Values, files: Files) -> TakeFile | None:
    """A take; its file must exist, and its content is read when it is played."""
    label = f"{values.context.label('file')}: "
    if values.written("input"):
        return _sound_input(values, files, label)
    for name in values.written(*_INPUT_NAMES):
        values.error("E111", f"{values.context.label(name)}: belongs to a take with `input`", name)
    if values["file"] is None:
        label = values.context.label("")
        message = f"{label} has neither a file nor an input; write `file` or `input`"
        values.context.error("E103", message, values.place)
        return None
    file, folder = values["file"], values.nodes["file"].document.folder
    path = folder / file
    if path.suffix.lower() == ".gms":
        values.error("E108", f"{label}ergon does not read GMS files yet", "file")
    elif path.suffix.lower() not in (*take_file.SUFFIXES, *note_files.SUFFIXES):
        forms = f"a take is a {', '.join(take_file.SUFFIXES)}, .mid or .musicxml file"
        values.error("E206", f"{label}{foreign_form(b'', path) or forms}", "file")
    else:
        path = files.locate(file, folder, values.place_of("file"), label, is_text=False) or path
    is_midi = path.suffix.lower() in note_files.SUFFIXES
    for name in values.written(*(("trim", "smooth", "rate", "unit") if is_midi else _MIDI_NAMES)):
        source_noun = "a file of notes" if is_midi else "a take that is not a MIDI or MusicXML file"
        values.error(
            "E111", f"{values.context.label(name)}: {source_noun} has no {name}; remove it", name
        )
    if note_files.is_musicxml(path) and values.written("bend"):
        message = f"{values.context.label('bend')}: a MusicXML file has no pitch wheel; remove it"
        values.error("E111", message, "bend")
    return TakeFile(
        name=values.context.name,
        path=path,
        channel=values["channel"],
        trim=values["trim"],
        smooth=values["smooth"],
        rate=values["rate"],
        unit=values["unit"],
        place=values.place,
        places={name: node.place for name, node in values.nodes.items()},
    )


def _sound_input(fields: Values, files: Files, label: str) -> TakeFile | None:
    """An input; missing fields and those that do not belong to it are reported."""
    for name in fields.written(*_REFUSED_INPUT_FIELDS):
        fields.error(
            "E111", f"{fields.context.label(name)}: an input has no {name}; remove it", name
        )
    is_osc = fields["input"] == OSC
    if fields["gain"] is None or fields["input"] is None:
        if not fields.written("gain"):
            message = (
                f"{fields.context.label('')} has no 'gain': what full scale is, such as 2mN or "
                "0.1mm"
            )
            fields.context.error("E103", message, fields.place)
        return None
    gain, is_force = fields["gain"]
    clamp, is_clamp_force = fields["clamp"] or (abs(gain), is_force)
    if is_clamp_force != is_force:
        unit = "a force" if is_force else "a length"
        fields.error(
            "E111", f"{fields.context.label('clamp')}: `gain` is {unit}, so `clamp` is one", "clamp"
        )
    elif clamp < 0.0:
        fields.error(
            "E202",
            f"{fields.context.label('clamp')}: this limit acts in both directions; write it "
            "without a sign",
            "clamp",
        )
    path = None
    if fields["file"] is not None:
        folder = fields.nodes["file"].document.folder
        path = folder / fields["file"]
        if path.suffix.lower() != ".wav":
            fields.error("E206", f"{label}what an input hears is a .wav file", "file")
        else:
            path = (
                files.locate(fields["file"], folder, fields.place_of("file"), label, is_text=False)
                or path
            )
    elif fields["channel"] is not None:
        message = (
            f"{fields.context.label('channel')}: is of a file, and the input has none; remove it"
        )
        fields.error("E111", message, "channel")
    highpass = _INPUT_HIGHPASS_HZ if fields["highpass"] is None else fields["highpass"]
    glide = _INPUT_GLIDE_SECONDS if fields["glide"] is None else fields["glide"]
    for name in fields.written("highpass" if is_osc else "glide"):
        source_noun = "an input by OSC" if is_osc else "an input of the sound card"
        fields.error(
            "E111", f"{fields.context.label(name)}: {source_noun} has no {name}; remove it", name
        )
    if glide > _INPUT_GLIDE_SECONDS_MAX:
        message = (
            f"{fields.context.label('glide')}: the longest glide is {_INPUT_GLIDE_SECONDS_MAX:g} s"
        )
        fields.error("E202", message, "glide")
    return TakeFile(
        name=fields.context.name,
        path=path,
        channel=fields["channel"],
        trim=None,
        smooth=None,
        rate=None,
        unit=None,
        place=fields.place,
        places={name: node.place for name, node in fields.nodes.items()},
        input=SoundInput(
            None if is_osc else fields["input"],
            gain,
            is_force,
            None if is_osc else highpass,
            clamp,
            glide if is_osc else None,
        ),
    )


def strikes(values: Values, targets: tuple[Target, ...]) -> Strikes:
    """Strikes on the targets that their names reach."""
    fields = values
    _check_force(fields)
    if fields.written("rate") and (contrary_fields := fields.written("every", "times")):
        fields.error(
            "E111",
            f"{fields.context.label(contrary_fields[0])}: `rate` is written too; keep one of "
            "the two",
            contrary_fields[0],
        )
    if fields.written("for") and fields.written("until"):
        fields.error(
            "E111",
            f"{fields.context.label('until')}: `for` is written too; keep one of the two",
            "until",
        )
    if fields.written("rate") and not fields.written("for", "until"):
        fields.error(
            "E103",
            f"{fields.context.label('rate')}: the strikes have no end; write `for` or `until`",
            "rate",
        )
    if fields.written("rate") and (contrary_fields := fields.written(*PATTERN_FIELDS, "notes")):
        fields.error(
            "E111",
            f"{fields.context.label(contrary_fields[0])}: strikes by chance have no steps; write "
            "`every` instead of `rate`",
            contrary_fields[0],
        )
    if (
        contrary_fields := fields.written("notes", "chance", "swing", "skip")
    ) and not fields.written("rate", "every", "euclid"):
        message = (
            f"{fields.context.label(contrary_fields[0])}: the length of a step is missing; "
            "write `every`"
        )
        fields.error("E103", message, contrary_fields[0])
    if not fields.written("rate", "every", "euclid") and (
        repeating_fields := fields.written("times", "for", "until")
    ):
        message = (
            f"{fields.context.label(repeating_fields[0])}: the time between strikes is missing; "
            "write `every`, or `rate` for strikes by chance"
        )
        fields.error("E103", message, repeating_fields[0])
    pattern_order = single_name_pattern(fields.context.name)
    notes: Mapping[str, Amount] = {}
    if fields["notes"] is not None:
        node = fields.nodes["notes"]
        assert isinstance(node, Scalar)
        try:
            pattern_order, notes = parse_with_names(node, _value_pattern)
        except TextError as error:
            fields.context.text_error(error, node, "notes")
    has_pattern = fields.written(*PATTERN_FIELDS, "notes")
    pattern_values = cast("PatternValues", fields.by_name)
    pattern = pattern_of(pattern_values, pattern_order) if has_pattern else None
    strikes_without_notes = _common_strikes(fields, targets)
    return replace(
        strikes_without_notes, span=fields["for"], rate=fields["rate"], pattern=pattern, notes=notes
    )


def _common_strikes(fields: Values, targets: tuple[Target, ...]) -> Strikes:
    """Strikes with what every kind of them may have."""
    return Strikes(
        name=fields.context.name,
        to=targets,
        at=fields["at"],
        until=fields["until"],
        every=fields["every"],
        times=fields["times"],
        levels=fields["impulse"] or (None if fields.written("mass") else Levels((MEZZO_FORTE,))),
        mass=fields["mass"],
        speed=fields["speed"],
        place=fields.place,
        lasts=fields["lasts"],
    )


def _check_force(values: Values) -> None:
    """Check that strikes have `impulse`, both `mass` and `speed`, or neither; reports errors."""
    if values.written("impulse"):
        has_single(values, ("impulse",), ("mass", "speed"))
    if values.written("lasts"):
        has_single(values, ("lasts",), ("mass", "speed"))
    if len(force_fields := values.written("mass", "speed")) == 1:
        values.error(
            "E103", f"{values.context.label('')} needs both mass and speed", force_fields[0]
        )


def rhythm_strikes(values: Values, targets: tuple[Target, ...]) -> Strikes:
    """Strikes by a rhythm that is not read yet, on all that its words strike."""
    if values.written("for") and values.written("until"):
        message = f"{values.context.label('until')}: `for` is written too; keep one of the two"
        values.error("E111", message, "until")
    return replace(_common_strikes(values, targets), span=values["for"])


def passing_strikes(values: Values, targets: tuple[Target, ...]) -> Strikes:
    """Strikes by a sweep or along a path, on the targets that their names reach."""
    _check_force(values)
    return replace(
        _common_strikes(values, targets), length=values["for"], passing=read_passing(values)
    )


def _moved_to_start(
    parsed_notation: notation.Notation, source: str, text: Scalar
) -> notation.Notation:
    """The notation; its places are set to the beginning if names of values were replaced in the
    text.
    """
    if source == text.text:
        return parsed_notation
    points = tuple(replace(point, offset=0, length=1) for point in parsed_notation.points)
    bar_checks = tuple(replace(bar_check, offset=0) for bar_check in parsed_notation.bar_checks)
    return replace(parsed_notation, points=points, bar_checks=bar_checks)


def _value_pattern(text: str) -> tuple[Group, Mapping[str, Amount]]:
    return parse_values(text, amount_reader(value_kinds.PITCH.parse, "f"), is_pitch=True)


def melody(values: Values, hits: tuple[Hit, ...], length: Length | None) -> Strikes:
    """A melody whose strikes are known; `length` is that of a phrase."""
    fields = values
    targets = dict.fromkeys(target for hit in hits for target in hit.to)
    return Strikes(
        name=fields.context.name,
        to=tuple(targets),
        at=fields["at"] or BEGINNING,
        until=fields["until"],
        every=fields["every"],
        times=fields["times"],
        place=fields.place,
        hits=hits,
        length=length,
        lasts=fields["lasts"],
    )


def player(values: Values) -> Player:
    """A player; for a live one a note says what plays in its place."""
    fields = values
    if fields["hand"] == "live":
        stand_in_text = f"its stand-in {fields['standin']}" if fields["standin"] else "its part"
        label = fields.context.label("")
        message = (
            f"{label}: {stand_in_text} plays in place of a real hand; `ergon duet` connects one"
        )
        fields.error("N401", message, "hand")
    context = fields.context
    return Player(
        context.name,
        fields["hand"],
        fields["key"],
        fields["device"],
        fields["standin"],
        fields["tick"],
        fields.place,
    )


def coupling(values: Values, coupling_index: int) -> Coupling | None:
    """A coupling of two keys, whose names are not looked up yet."""
    coupling_values = values
    link_values = coupling_values.by_name.get(coupling_values.kind)
    if not isinstance(link_values, Values) or len(coupling_values["couple"]) != 2:
        return None
    first_key, second_key = coupling_values["couple"]
    link_module = make_module(f"duet{coupling_index}", coupling_values.kind, link_values)
    end_position = coupling_values["until"]
    begin_position = coupling_values["at"] or BEGINNING
    return Coupling(
        link_module,
        _unresolved_target(first_key),
        _unresolved_target(second_key),
        begin_position,
        end_position,
        coupling_values.node.place,
    )


def _unresolved_target(name: Any) -> Target:
    return Target(str(name), "", 0, 1, str(name), name.place)


def tempo(values: Values, file_tempos: tuple[tuple[float, float], ...] = ()) -> TempoEntry:
    """A line of `tempo:`, with the tempos of the file that it names."""
    bpm, bpm_end = values["bpm"] or (None, None)
    place, ramp_length, meter = values.node.place, values["over"], values["meter"]
    return TempoEntry(
        values["at"] or BEGINNING, bpm, bpm_end, ramp_length, meter, place, file_tempos
    )
