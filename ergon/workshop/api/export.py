"""Parts of a score for other programs: tables of modes, programs of Faust, models of mi-gen."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.api import score as scores
from ergon.api.modes import compute_modes
from ergon.api.options import ReadOptions
from ergon.api.parts import frequency_option, selected_parts
from ergon.common.option import documented, option
from ergon.common.report import Report

from .banks import bank_of, impulse_divisor, is_heard, omissions, shapes_at_contacts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.api.modes import PartModes
    from ergon.instruments.model import Target
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.workshop.models.programs.bank import Bank
    from ergon.workshop.models.programs.elements import Part, SteppedNetwork

FREQUENCY_MAX = 20_000.0  # [Hz] nobody hears a mode above it


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions(ReadOptions):
    """Which parts are exported.

    `parts` are names of instruments and keys; without any, all are exported. A frequency is a
    number [Hz] or a text such as "5kHz".
    """

    parts: Sequence[str] = ()
    upto: float | str | None = option(
        None,
        "Of modal and csound: the highest mode (20kHz). Of faust: banks of the modes up to it.",
        metavar="FREQUENCY",
    )


@dataclass(frozen=True, slots=True)
class ExportedPart:
    """A file for another program: its text, and what it leaves out, in sentences."""

    part: str
    text: str
    warnings: tuple[str, ...]
    inputs: tuple[Path, ...]


def mode_tables(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """The modes of parts of a score, a CSV table for each part that has modes.

    An impulse J [N·s] at a point moves another by the sum of J·A·exp(-d·t)·sin(2π·f·t + p) [m]
    over the modes. The columns hold f [Hz], d [1/s] with its T60 [s], and, for each pair of a
    struck or touched point and a heard one, A [m/(N·s)] and p [rad]. Raises ScoreError and
    OptionError.
    """
    from ergon.scores.staging.preparing import prepare

    options = options or ExportOptions()
    upto = FREQUENCY_MAX if options.upto is None else frequency_option("upto", options.upto)
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    part_names = selected_parts(piece, options.parts)
    ca_rates = {name: modes.ca_rate for name, modes in piece.instruments.items()}
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("computing modes"):
        built = prepare(piece).built_network
        modes_by_part = [
            compute_modes(piece, built, name, {"to": upto}, loaded.inputs) for name in part_names
        ]
        modes_and_points = [
            (modes, {**modes.points, **shapes_at_contacts(piece, built, modes)})
            for modes in modes_by_part
        ]
    return tuple(
        _mode_table(modes, points, ca_rates.get(modes.part))
        for modes, points in modes_and_points
        if modes.masses
    )


def faust_programs(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """Parts of a score as programs of Faust; without `parts` one program, of all parts together.

    A program steps masses, springs, dampers, contacts and laws sample by sample as the engine
    does, at the rate of the score. With `upto`, and always for a named part that has a MODES,
    the part becomes a bank of resonators, with its contacts open, at any rate. Inputs of a
    program are the forces [N] on struck points and of ENF, and the positions [m] of ENX; its
    outputs are those of the parts. Links to other parts are left out. Raises ScoreError,
    OptionError, and ModelError with the places of what cannot be exported.
    """
    from ergon.workshop.models.programs.faust_bank import BANK_MAX as RESONATORS
    from ergon.workshop.models.programs.faust_bank import program as bank_program
    from ergon.workshop.models.programs.faust_program import program
    from ergon.workshop.models.programs.network import NETWORK_MAX

    options = options or ExportOptions()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    if options.upto is not None:
        upto = frequency_option("upto", options.upto)
        with scores.staging(lambda: loaded, report):
            bank_names = audible_parts(piece, options.parts)
            return banks_of(
                piece, loaded.inputs, bank_names, upto, bank_program, RESONATORS, report
            )
    bank_names = [name for name in options.parts if _is_bank(piece, name)]
    if not bank_names:
        return _programs(score, loaded, options, program, points_max=NETWORK_MAX)
    remaining_parts = [name for name in options.parts if name not in bank_names]
    with scores.staging(lambda: loaded, report):
        exported = banks_of(
            piece, loaded.inputs, bank_names, FREQUENCY_MAX, bank_program, RESONATORS, report
        )
    if remaining_parts:
        part_options = replace(options, parts=remaining_parts)
        exported += _programs(score, loaded, part_options, program, points_max=NETWORK_MAX)
    return tuple(
        sorted(exported, key=lambda exported_part: options.parts.index(exported_part.part))
    )


def audible_parts(piece: Piece, parts: Sequence[str]) -> list[str]:
    """The named parts; without names, those whose motion is heard, or all if there is none."""
    names = selected_parts(piece, parts)
    audible = [name for name in names if parts or is_heard(piece, name)]
    return audible or list(names)  # if nothing is heard, the first part is refused later


def _is_bank(piece: Piece, name: str) -> bool:
    instrument = piece.instruments.get(name)
    return instrument is not None and any(module.kind == "MODES" for module in instrument.modules)


def banks_of(
    piece: Piece,
    inputs: tuple[Path, ...],
    names: Sequence[str],
    upto: float,
    bank_text: Callable[[Bank], str],
    n_modes_max: int,
    report: Report | None,
) -> tuple[ExportedPart, ...]:
    """A file for each part that has modes up to `upto` [Hz], with `n_modes_max` resonators at most.

    Raises ScoreError and OptionError.
    """
    banks = part_banks(piece, inputs, names, upto, n_modes_max, report)
    return tuple(
        ExportedPart(bank.name, bank_text(bank), warnings, inputs) for bank, warnings in banks
    )


def part_banks(
    piece: Piece,
    inputs: tuple[Path, ...],
    names: Sequence[str],
    upto: float,
    n_modes_max: int,
    report: Report | None,
) -> list[tuple[Bank, tuple[str, ...]]]:
    """Each part that has modes up to `upto` [Hz] as a bank of `n_modes_max` resonators at most, and
    what that leaves out, in sentences. Raises ScoreError and OptionError.
    """
    from ergon.scores.staging.preparing import prepare

    upto = min(upto, 0.499 * piece.rate)
    banks = []
    with (report or Report()).waiting("computing modes"):
        prepared = prepare(piece)
        for name in names:
            modes = compute_modes(piece, prepared.built_network, name, {"to": upto}, inputs)
            if modes.masses:
                bank = bank_of(piece, prepared, modes, n_modes_max)
                banks.append((bank, tuple(omissions(modes))))
    return banks


def mi_gen_models(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """Parts of a score as models of mi-gen (v2); without `parts` one model, of all parts together.

    Inputs are those of a program of Faust; an output hears one point, or the links of one point.
    Raises ScoreError, OptionError, and ModelError with the places of what the format cannot say.
    """
    from ergon.workshop.models.programs.mi_gen import NETWORK_MAX, model_text

    options = options or ExportOptions()
    loaded = scores.read(score, options, report)
    return _programs(score, loaded, options, model_text, points_max=NETWORK_MAX)


def _programs(
    score: str | Path,
    loaded: Loaded,
    export_options: ExportOptions,
    program: Callable[[SteppedNetwork, str], str],
    *,
    points_max: int,
) -> tuple[ExportedPart, ...]:
    from ergon.workshop.models.programs.network import stepped_network

    piece = scores.piece_of(loaded)
    title = Path(score).stem if str(score) != scores.STDIN else "score"
    names = selected_parts(piece, export_options.parts)
    parts_by_file = (
        [(name, (name,)) for name in names] if export_options.parts else [(title, names)]
    )
    exported = []
    for program_name, part_names in parts_by_file:
        parts, struck = _parts(piece, part_names), _struck_points(piece, part_names)
        network = stepped_network(parts, struck, piece.rate, points_max=points_max)
        warnings = tuple(f"{omission} is left out" for omission in network.omissions)
        exported.append(
            ExportedPart(program_name, program(network, program_name), warnings, loaded.inputs)
        )
    return tuple(exported)


def _parts(piece: Piece, part_names: Sequence[str]) -> list[Part]:
    from ergon.workshop.models.errors import ModelError
    from ergon.workshop.models.programs.elements import Part

    for part_name in part_names:
        if part_name in piece.keys and piece.keys[part_name].reach != 1.0:
            error = ModelError(
                f"key {part_name} has a lever (`reach`), which this format cannot "
                "hold; name other PARTs",
                piece.keys[part_name].place.line,
            )
            error.file = piece.keys[part_name].place.file
            raise error
    for part_name in part_names:
        if part_name in piece.instruments and piece.instruments[part_name].space is not None:
            error = ModelError(
                f"{part_name} is an instrument in space, which this format cannot "
                "hold; name other PARTs",
                piece.instruments[part_name].place.line,
            )
            error.file = piece.instruments[part_name].place.file
            raise error
    if piece.duet and len(part_names) == len(piece.keys) + len(piece.instruments):
        error = ModelError(
            "this format cannot hold a coupling that begins and ends; name the PARTs to export",
            piece.duet[0].place.line,
        )
        error.file = piece.duet[0].place.file
        raise error
    program_parts = []
    for part_name in part_names:
        if part_name in piece.keys:
            key = piece.keys[part_name]
            program_parts.append(Part(part_name, key.modules, struck_module=key.struck))
        else:
            instrument = piece.instruments[part_name]
            program_parts.append(
                Part(part_name, instrument.modules, instrument.outputs, instrument.ca_rate)
            )
    return program_parts


def _struck_points(piece: Piece, part_names: Sequence[str]) -> list[Target]:
    """Points of these parts that are struck, or that links with other parts end on."""
    targets = [target for strike in piece.strikes for target in strike.to]
    for owner, module in piece.modules():
        ends = module.ends
        if any(end.part not in part_names for end in ends) or owner not in part_names:
            targets += ends
    return [target for target in targets if target.part in part_names]


def _mode_table(
    part_modes: PartModes, shapes: Mapping[str, NDArray[np.complex128]], ca_rate: float | None
) -> ExportedPart:
    import numpy as np

    is_oscillating = part_modes.poles.imag > 0.0
    poles = part_modes.poles[is_oscillating]
    columns: dict[str, NDArray[np.float64]] = {
        "frequency [Hz]": part_modes.frequencies[is_oscillating],
        "T60 [s]": part_modes.t60[is_oscillating],
        "decay [1/s]": 0.0 - poles.real,
    }
    divisor = impulse_divisor(poles, ca_rate)
    points = {label: shape[is_oscillating] for label, shape in shapes.items()}
    for struck_label, output_label in _point_pairs(points):
        gains = points[struck_label] * points[output_label] / divisor
        columns[f"amplitude {struck_label} to {output_label} [m/Ns]"] = np.abs(gains)
        columns[f"phase {struck_label} to {output_label} [rad]"] = np.angle(gains)
    text = io.StringIO()
    text.write(f"# modes of {part_modes.part}, made by ergon\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("mode", *columns))
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    writer.writerows((number, *map(repr, row)) for number, row in enumerate(rows, 1))
    return ExportedPart(
        part_modes.part, text.getvalue(), tuple(omissions(part_modes)), part_modes.inputs
    )


def _point_pairs(named_points: Mapping[str, object]) -> list[tuple[str, str]]:
    """Pairs of a struck or touched point and a heard one; if one kind is missing, the other
    replaces it.
    """
    output_labels = [label for label in named_points if label.split(" ")[0] == "out"]
    struck_labels = [label for label in named_points if label not in output_labels]
    return [
        (struck_label, output_label)
        for struck_label in struck_labels or output_labels
        for output_label in output_labels or struck_labels
    ]
