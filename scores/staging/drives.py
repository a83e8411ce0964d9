"""What drives masses from outside: inputs, and imposed positions and forces (ENX, ENF)."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.notation.text.errors import quote
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import Hands
from ergon.scores.staging.takes import Takes


def sounds_in(piece: Piece, timeline: _core.Timeline, takes: Takes) -> dict[str, tuple[int, float]]:
    """The inputs by name: the number of each, and the length [s] of its file."""
    sounds_by_name: dict[str, tuple[int, float]] = {}
    for take_name, take in piece.takes.items():
        if (sound_input := take.input) is None:
            continue
        if sound_input.highpass is not None and sound_input.highpass >= 0.5 * piece.rate:
            message = f"take {quote(take_name)}: its highpass is not below half of the rate"
            place = take.places.get("highpass", take.place)
            takes.collector.error("E308", message, place)
        elif (sound_samples := takes.sound(take_name)) is not None:
            settings = {"gain": sound_input.gain, "clamp": sound_input.clamp}
            if sound_input.channel is None:
                number, glide = input_number(take_name), sound_input.glide or 0.0
                input_index = timeline.controlled_input(
                    number, sound_samples, **settings, glide=glide
                )
            else:
                highpass = sound_input.highpass
                input_index = timeline.sound_in(
                    sound_input.channel - 1, sound_samples, **settings, highpass=highpass
                )
            sounds_by_name[take_name] = input_index, len(sound_samples) / piece.rate
    return sounds_by_name


def input_number(input_name: str) -> int:
    """The engine's number of an OSC input; it is derived from the name, so that it is the same in
    every version.
    """
    return int.from_bytes(sha256(input_name.encode()).digest()[:8])


def drive(piece: Piece, assembly: Assembly, hands: Hands, sounds: Mapping[str, int]) -> None:
    """Impose positions (ENX) and forces (ENF) by a constant, a take or an input."""
    tempo = piece.tempo_map
    keys = [(name, key.modules, key.reach) for name, key in piece.keys.items()]
    instruments = [(name, i.modules, 1.0) for name, i in piece.instruments.items()]
    for part_name, modules, lever_ratio in (*keys, *instruments):
        for part_module in modules:
            if part_module.kind not in ("ENX", "ENF"):
                continue
            mat = assembly.mat(part_module.driven_mat)
            is_position = part_module.kind == "ENX"
            # Behind a lever positions are multiplied by s, and forces divided by s.
            scale = lever_ratio if is_position else 1.0 / lever_ratio
            drive_source, begin_position = part_module.fields["from"], part_module.fields["at"]
            constant = drive_source * scale if isinstance(drive_source, float) else None
            sound_input = sounds.get(str(drive_source))
            take = None
            if constant is None and sound_input is None:
                known_take = piece.takes.get(str(drive_source))
                take = (
                    None
                    if known_take is None or known_take.input
                    else hands.takes.get(str(drive_source))
                )
                if take is None:
                    continue  # reported already
            hands.timeline.drive(
                mat,
                "position" if is_position else "force",
                constant=constant,
                take=take,
                sound=sound_input,
                start=0.0
                if begin_position is None
                else tempo.seconds(tempo.resolve(begin_position)),
                scale=scale * part_module.fields["scale"],
                acts_on_free_key=part_module.driven_mat.part == part_name,
            )
