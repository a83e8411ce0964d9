"""Makes what moves and plays in a piece from the values that were read, and checks their fields
together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from ergon.instruments.model import Module, Target
from ergon.instruments.read import module
from ergon.instruments.read import modules as read_modules
from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import parse_with_names
from ergon.notation.tables.strengths import MEZZO_FORTE, Levels
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.document import Scalar
from ergon.notation.text.errors import TextError
from ergon.notation.text.files import Files
from ergon.scores.gesture import notation, note_files, space_path, take_file
from ergon.scores.pattern.order import Group, plain
from ergon.scores.pattern.values import Amount, parse_values
from ergon.scores.reading import calibration
from ergon.scores.reading.automatable import amount_reader
from ergon.scores.reading.gesture_tables import OSC
from ergon.scores.reading.patterns import PATTERN_FIELDS, PatternValues, pattern_of
from ergon.scores.reading.piece import Hit, Strikes, TempoEntry
from ergon.scores.reading.playing import Coupling, Gesture, Key, Player, SoundInput, TakeFile
from ergon.scores.reading.playing_options import OptionValues, playing_options
from ergon.scores.reading.sweep_fields import passing

START = Position()


def has_single(section_values: Values, *field_groups: tuple[str, ...]) -> bool:
    """Whether fields of exactly one group are written; reports two, or none."""
    present = [group for group in field_groups if section_values.written(*group)]
    if len(present) > 1:
        a, b = section_values.written(*present[0])[0], section_values.written(*present[1])[0]
        section_values.error(
            "E111", f"{section_values.context.label(b)}: {a} is written too; keep one of the two", b
        )
    elif not present:
        alternatives = " or ".join(group[0] for group in field_groups)
        section_values.error("E103", f"{section_values.context.label('')} needs {alternatives}")
    return len(present) == 1


def key(section_values: Values, files: Files) -> Key:
    """A key; `calib:` supplies what is not written here."""
    measured = calibration.measured_values(section_values, files)
    if measured is not None:
        section_values = calibration.with_measured_fields(section_values, measured)
    cel = ("M", "K", "Z", "f", "t60")
    key_modules: tuple[Module, ...] = ()
    if section_values.written("modules"):
        if contrary_fields := section_values.written(*cel):
            message = (
                f"{section_values.context.label(contrary_fields[0])}: `modules` is written too; "
                "keep one of the two"
            )
            section_values.error("E111", message, contrary_fields[0])
        if not section_values.written("struck"):
            message = (
                f"{section_values.context.label('')} has no `struck`; write the module that ergons "
                "strike"
            )
            section_values.error("E103", message)
        key_modules = read_modules(section_values)
    else:
        if not section_values.written("M"):
            section_values.error(
                "E103", f"{section_values.context.label('')} has no 'M': its mass, such as 400g"
            )
        has_single(section_values, ("K", "Z"), ("f", "t60"))
        fields = {name: section_values[name] for name in (*cel, "rest", "X0", "V0")}
        places = {name: node.place for name, node in section_values.nodes.items()}
        key_modules = (Module("", "CEL", fields, section_values.place, places),)
        if measured is not None and not section_values["simple"]:
            end = calibration.resting_end(section_values, measured)
            key_modules = calibration.key_modules(key_modules[0], measured, end)
    travel = section_values["travel"]
    if travel is not None and not travel[0] <= section_values["X0"] <= travel[1]:
        message = f"{section_values.context.label('X0')}: the key begins outside its travel"
        section_values.error("E202", message, "X0")
    struck_module = section_values["struck"] or ""
    constants = None if measured is None else calibration.key_constants(measured)
    delay = section_values["delay"]
    if delay is None and constants is not None and not section_values["simple"]:
        delay = constants[2]
    if constants is not None:
        constants = *constants[:2], delay
    key_arguments = (
        section_values.context.name,
        key_modules,
        struck_module,
        travel,
        section_values["reach"],
        section_values.place,
    )
    return Key(*key_arguments, measured=constants, delay=delay or 0.0)


def gestures(section_values: Values, room: int = notation.MAX_EVENTS) -> dict[str, Gesture] | None:
    """Gestures with at most `room` points: one by the name "", or one for each axis of a path in
    space.

    None if an error was reported.
    """
    if not has_single(section_values, ("notation",), ("points",)):
        return None
    field_name = section_values.written("notation", "points")[0]
    field_text = section_values.by_name.get(field_name)
    if not isinstance(field_text, Scalar):
        return None

    def parse(notation_source: str) -> tuple[notation.Notation, ...]:
        if field_name == "notation" and space_path.axes(notation_source) > 1:
            return space_path.parse(notation_source, section_values["curve"], room)
        parse_one = notation.parse if field_name == "notation" else notation.parse_table
        return (parse_one(notation_source, section_values["curve"], room),)

    try:
        read_notation = parse_with_names(
            field_text,
            lambda gesture_text: [
                _is_at_start(gesture, gesture_text, field_text) for gesture in parse(gesture_text)
            ],
        )
    except TextError as error:
        section_values.context.text_error(error, field_text, "")
        return None
    manner = playing_options(cast("OptionValues", section_values.by_name))
    options = section_values["do"] or (), manner, section_values.place, field_text
    parsed = [
        Gesture(section_values.context.name, gesture.points, gesture.bar_checks, *options)
        for gesture in read_notation
    ]
    return {"": parsed[0]} if len(parsed) == 1 else dict(zip(AXES, parsed, strict=False))


_HIGHPASS = 20.0  # default high-pass of an input [Hz]
_GLIDE = 0.02  # default glide between two values by OSC [s]
_GLIDE_MAX = 60.0  # [s]
_INPUT_NAMES = ("gain", "highpass", "clamp", "glide")
_MIDI_NAMES = ("velocity", "depth", "curve")
_NOT_OF_INPUTS = (*_MIDI_NAMES, "trim", "smooth", "rate", "unit")


def take(values: Values, score_files: Files) -> TakeFile | None:
    """A take; its file must exist, and its content is read when it is played."""
    take_values, error_label = values, f"{values.context.label('file')}: "
    if take_values.written("input"):
        return _input(take_values, score_files, error_label)
    for field_name in take_values.written(*_INPUT_NAMES):
        take_values.error(
            "E111",
            f"{take_values.context.label(field_name)}: belongs to a take with `input`",
            field_name,
        )
    if take_values["file"] is None:
        message = (
            f"{take_values.context.label('')} has neither a file nor an input; write `file` or "
            "`input`"
        )
        take_values.context.error("E103", message, take_values.place)
        return None
    written_file, folder = take_values["file"], take_values.nodes["file"].document.folder
    path = folder / written_file
    if path.suffix.lower() == ".gms":
        take_values.error("E108", f"{error_label}ergon does not read GMS files yet", "file")
    elif path.suffix.lower() not in (*take_file.SUFFIXES, *note_files.SUFFIXES):
        take_values.error(
            "E206",
            f"{error_label}a take is a {', '.join(take_file.SUFFIXES)}, .mid or .musicxml file",
            "file",
        )
    else:
        path = (
            score_files.locate(
                written_file, folder, take_values.place_of("file"), error_label, is_text=False
            )
            or path
        )
    is_midi = path.suffix.lower() in note_files.SUFFIXES
    for field_name in take_values.written(
        *(("trim", "smooth", "rate", "unit") if is_midi else _MIDI_NAMES)
    ):
        which = "a file of notes" if is_midi else "a take that is not a MIDI or MusicXML file"
        take_values.error(
            "E111",
            f"{take_values.context.label(field_name)}: {which} has no {field_name}; remove it",
            field_name,
        )
    if note_files.is_musicxml(path) and take_values.written("bend"):
        message = (
            f"{take_values.context.label('bend')}: a MusicXML file has no pitch wheel; remove it"
        )
        take_values.error("E111", message, "bend")
    return TakeFile(
        name=take_values.context.name,
        path=path,
        channel=take_values["channel"],
        trim=take_values["trim"],
        smooth=take_values["smooth"],
        rate=take_values["rate"],
        unit=take_values["unit"],
        place=take_values.place,
        places={name: node.place for name, node in take_values.nodes.items()},
    )


def _input(values: Values, files: Files, error_label: str) -> TakeFile | None:
    """An input; missing fields and those that do not belong to it are reported."""
    label = values.context.label
    for field_name in values.written(*_NOT_OF_INPUTS):
        values.error(
            "E111", f"{label(field_name)}: an input has no {field_name}; remove it", field_name
        )
    is_osc = values["input"] == OSC
    if values["gain"] is None or values["input"] is None:
        if not values.written("gain"):
            message = f"{label('')} has no 'gain': what full scale is, such as 2mN or 0.1mm"
            values.context.error("E103", message, values.place)
        return None
    input_gain, is_force = values["gain"]
    clamp, is_clamp_force = values["clamp"] or (abs(input_gain), is_force)
    if is_clamp_force != is_force:
        unit_noun = "a force" if is_force else "a length"
        values.error("E111", f"{label('clamp')}: `gain` is {unit_noun}, so `clamp` is one", "clamp")
    elif clamp < 0.0:
        values.error(
            "E202",
            f"{label('clamp')}: this limit acts in both directions; write it without a sign",
            "clamp",
        )
    path = None
    if values["file"] is not None:
        folder = values.nodes["file"].document.folder
        path = folder / values["file"]
        if path.suffix.lower() != ".wav":
            values.error("E206", f"{error_label}what an input hears is a .wav file", "file")
        else:
            path = (
                files.locate(
                    values["file"], folder, values.place_of("file"), error_label, is_text=False
                )
                or path
            )
    elif values["channel"] is not None:
        message = f"{label('channel')}: is of a file, and the input has none; remove it"
        values.error("E111", message, "channel")
    highpass = _HIGHPASS if values["highpass"] is None else values["highpass"]
    glide = _GLIDE if values["glide"] is None else values["glide"]
    for field_name in values.written("highpass" if is_osc else "glide"):
        which = "an input by OSC" if is_osc else "an input of the sound card"
        values.error(
            "E111", f"{label(field_name)}: {which} has no {field_name}; remove it", field_name
        )
    if glide > _GLIDE_MAX:
        message = f"{label('glide')}: the longest glide is {_GLIDE_MAX:g} s"
        values.error("E202", message, "glide")
    return TakeFile(
        name=values.context.name,
        path=path,
        channel=values["channel"],
        trim=None,
        smooth=None,
        rate=None,
        unit=None,
        place=values.place,
        places={name: node.place for name, node in values.nodes.items()},
        input=SoundInput(
            None if is_osc else values["input"],
            input_gain,
            is_force,
            None if is_osc else highpass,
            clamp,
            glide if is_osc else None,
        ),
    )


def strikes(values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes on the targets that their names reach."""
    strike_values = values
    _check_force(strike_values)
    if strike_values.written("rate") and (
        contrary_fields := strike_values.written("every", "times")
    ):
        strike_values.error(
            "E111",
            f"{strike_values.context.label(contrary_fields[0])}: `rate` is written too; keep one "
            "of the two",
            contrary_fields[0],
        )
    if strike_values.written("for") and strike_values.written("until"):
        strike_values.error(
            "E111",
            f"{strike_values.context.label('until')}: `for` is written too; keep one of the two",
            "until",
        )
    if strike_values.written("rate") and not strike_values.written("for", "until"):
        strike_values.error(
            "E103",
            f"{strike_values.context.label('rate')}: the strikes have no end; write `for` or "
            "`until`",
            "rate",
        )
    if strike_values.written("rate") and (
        contrary_fields := strike_values.written(*PATTERN_FIELDS, "notes")
    ):
        strike_values.error(
            "E111",
            f"{strike_values.context.label(contrary_fields[0])}: strikes by chance have no steps; "
            "write "
            "`every` instead "
            "of `rate`",
            contrary_fields[0],
        )
    if (
        contrary_fields := strike_values.written("notes", "chance", "swing", "skip")
    ) and not strike_values.written("rate", "every", "euclid"):
        message = (
            f"{strike_values.context.label(contrary_fields[0])}: the length of a step is missing; "
            "write `every`"
        )
        strike_values.error("E103", message, contrary_fields[0])
    if not strike_values.written("rate", "every", "euclid") and (
        many := strike_values.written("times", "for", "until")
    ):
        message = (
            f"{strike_values.context.label(many[0])}: the time between strikes is missing; "
            "write `every`, or `rate` for strikes by chance"
        )
        strike_values.error("E103", message, many[0])
    note_order = plain(strike_values.context.name)
    note_amounts: Mapping[str, Amount] = {}
    if strike_values["notes"] is not None:
        notes_node = strike_values.nodes["notes"]
        assert isinstance(notes_node, Scalar)
        try:
            note_order, note_amounts = parse_with_names(notes_node, _pitches)
        except TextError as error:
            strike_values.context.text_error(error, notes_node, "notes")
    has_pattern = strike_values.written(*PATTERN_FIELDS, "notes")
    written = cast("PatternValues", strike_values.by_name)
    pattern = pattern_of(written, note_order) if has_pattern else None
    bare = _bare_strikes(strike_values, to)
    return replace(
        bare,
        span=strike_values["for"],
        rate=strike_values["rate"],
        pattern=pattern,
        notes=note_amounts,
    )


def _bare_strikes(strike_values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes with what every kind of them may have."""
    return Strikes(
        name=strike_values.context.name,
        to=to,
        at=strike_values["at"],
        until=strike_values["until"],
        every=strike_values["every"],
        times=strike_values["times"],
        levels=strike_values["impulse"]
        or (None if strike_values.written("mass") else Levels((MEZZO_FORTE,))),
        mass=strike_values["mass"],
        speed=strike_values["speed"],
        place=strike_values.place,
        lasts=strike_values["lasts"],
    )


def _check_force(strike_values: Values) -> None:
    """Check that strikes have `impulse`, both `mass` and `speed`, or neither; reports errors."""
    if strike_values.written("impulse"):
        has_single(strike_values, ("impulse",), ("mass", "speed"))
    if strike_values.written("lasts"):
        has_single(strike_values, ("lasts",), ("mass", "speed"))
    if len(force_fields := strike_values.written("mass", "speed")) == 1:
        strike_values.error(
            "E103", f"{strike_values.context.label('')} needs both mass and speed", force_fields[0]
        )


def rhythm_strikes(strike_values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes by a rhythm that is not read yet, on all that its words strike."""
    if strike_values.written("for") and strike_values.written("until"):
        message = (
            f"{strike_values.context.label('until')}: `for` is written too; keep one of the two"
        )
        strike_values.error("E111", message, "until")
    return replace(_bare_strikes(strike_values, to), span=strike_values["for"])


def passing_strikes(values: Values, to: tuple[Target, ...]) -> Strikes:
    """Strikes by a sweep or along a path, on the targets that their names reach."""
    _check_force(values)
    return replace(_bare_strikes(values, to), length=values["for"], passing=passing(values))


def _is_at_start(
    read_notation: notation.Notation, notation_source: str, text_node: Scalar
) -> notation.Notation:
    """The notation; its places are set to the beginning if names of values were replaced in the
    text.
    """
    if notation_source == text_node.text:
        return read_notation
    points = tuple(replace(point, offset=0, length=1) for point in read_notation.points)
    checks = tuple(replace(check, offset=0) for check in read_notation.bar_checks)
    return replace(read_notation, points=points, bar_checks=checks)


def _pitches(text: str) -> tuple[Group, Mapping[str, Amount]]:
    return parse_values(text, amount_reader(k.PITCH.parse, "f"), is_pitch=True)


def melody(values: Values, phrase_hits: tuple[Hit, ...], phrase_length: Length | None) -> Strikes:
    """A melody whose strikes are known; `phrase_length` is that of a phrase."""
    melody_values = values
    targets = dict.fromkeys(target for hit in phrase_hits for target in hit.to)
    return Strikes(
        name=melody_values.context.name,
        to=tuple(targets),
        at=melody_values["at"] or START,
        until=melody_values["until"],
        every=melody_values["every"],
        times=melody_values["times"],
        place=melody_values.place,
        hits=phrase_hits,
        length=phrase_length,
        lasts=melody_values["lasts"],
    )


def player(values: Values) -> Player:
    """A player; for a live one a note says what plays in its place."""
    player_values = values
    if player_values["hand"] == "live":
        substitute = (
            f"its stand-in {player_values['standin']}" if player_values["standin"] else "its part"
        )
        label = player_values.context.label("")
        message = f"{label}: {substitute} plays in place of a real hand; `ergon duet` connects one"
        player_values.error("N401", message, "hand")
    context = player_values.context
    return Player(
        context.name,
        player_values["hand"],
        player_values["key"],
        player_values["device"],
        player_values["standin"],
        player_values["tick"],
        player_values.place,
    )


def coupling(values: Values, coupling_number: int) -> Coupling | None:
    """A coupling of two keys, whose names are not looked up yet."""
    coupling_values = values
    coupling_link = coupling_values.by_name.get(coupling_values.kind)
    if not isinstance(coupling_link, Values) or len(coupling_values["couple"]) != 2:
        return None
    a, b = coupling_values["couple"]
    link_module = module(f"duet{coupling_number}", coupling_values.kind, coupling_link)
    until_position = coupling_values["until"]
    begin = coupling_values["at"] or START
    return Coupling(
        link_module,
        _unresolved(a),
        _unresolved(b),
        begin,
        until_position,
        coupling_values.node.place,
    )


def _unresolved(name: Any) -> Target:
    return Target(str(name), "", 0, 1, str(name), name.place)


def tempo(tempo_values: Values, tempos: tuple[tuple[float, float], ...] = ()) -> TempoEntry:
    """A line of `tempo:`, with the tempos of the file that it names."""
    bpm, end = tempo_values["bpm"] or (None, None)
    place, over, meter = tempo_values.node.place, tempo_values["over"], tempo_values["meter"]
    return TempoEntry(tempo_values["at"] or START, bpm, end, over, meter, place, tempos)
