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


def add_inputs(
    piece: Piece, timeline: _core.Timeline, takes: Takes
) -> dict[str, tuple[int, float]]:
    """The inputs by name: the number of each, and the length [s] of its file."""
    input_by_name: dict[str, tuple[int, float]] = {}
    for take_name, take in piece.takes.items():
        if (input := take.input) is None:
            continue
        if input.highpass is not None and input.highpass >= 0.5 * piece.rate:
            message = f"take {quote(take_name)}: its highpass is not below half of the rate"
            place = take.places.get("highpass", take.place)
            takes.collector.error("E308", message, place)
        elif (samples := takes.input_samples(take_name)) is not None:
            settings = {"gain": input.gain, "clamp": input.clamp}
            if input.channel is None:
                engine_id, glide = input_id(take_name), input.glide or 0.0
                input_index = timeline.controlled_input(engine_id, samples, **settings, glide=glide)
            else:
                highpass = input.highpass
                input_index = timeline.sound_in(
                    input.channel - 1, samples, **settings, highpass=highpass
                )
            input_by_name[take_name] = input_index, len(samples) / piece.rate
    return input_by_name


def input_id(input_name: str) -> int:
    """The engine's number of an OSC input; it is derived from the name, so that it is the same in
    every version.
    """
    return int.from_bytes(sha256(input_name.encode()).digest()[:8])


def add_drives(piece: Piece, assembly: Assembly, hands: Hands, inputs: Mapping[str, int]) -> None:
    """Impose positions (ENX) and forces (ENF) by a constant, a take or an input."""
    tempo = piece.tempo_map
    key_parts = [(name, key.modules, key.reach) for name, key in piece.keys.items()]
    instrument_parts = [
        (name, instrument.modules, 1.0) for name, instrument in piece.instruments.items()
    ]
    for part_name, modules, lever_ratio in (*key_parts, *instrument_parts):
        for module in modules:
            if module.kind not in ("ENX", "ENF"):
                continue
            mat = assembly.mat(module.driven_mat)
            is_position = module.kind == "ENX"
            # Behind a lever positions are multiplied by s, and forces divided by s.
            scale = lever_ratio if is_position else 1.0 / lever_ratio
            source, begin = module.fields["from"], module.fields["at"]
            constant = source * scale if isinstance(source, float) else None
            input_index = inputs.get(str(source))
            take = None
            if constant is None and input_index is None:
                take_file = piece.takes.get(str(source))
                take = (
                    None if take_file is None or take_file.input else hands.takes.get(str(source))
                )
                if take is None:
                    continue  # reported already
            hands.timeline.drive(
                mat,
                "position" if is_position else "force",
                constant=constant,
                take=take,
                sound=input_index,
                start=0.0 if begin is None else tempo.seconds(tempo.resolve(begin)),
                scale=scale * module.fields["scale"],
                acts_on_free_key=module.driven_mat.part == part_name,
            )
