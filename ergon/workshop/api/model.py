"""A model of another program as a score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Literal

from ergon.api.errors import OptionError
from ergon.common.foreign_files import foreign_file
from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import DialectError, ModelError
from ergon.workshop.models.mims.grammar import DIALECT_NAMES, FORMS, Dialect
from ergon.workshop.models.mims.laws import Laws
from ergon.workshop.models.mims.model import Model
from ergon.workshop.models.mims.reading import is_mims, is_table, parse, read_text
from ergon.workshop.models.mims.score import score_text
from ergon.workshop.models.miphysics.reading import is_model as is_miphysics
from ergon.workshop.models.miphysics.reading import parse as miphysics_network
from ergon.workshop.models.miphysics.score import RATES
from ergon.workshop.models.miphysics.score import score_text as miphysics_score_text
from ergon.workshop.models.page import OSC, RATE, Input
from ergon.workshop.models.pmpd.interpreter import network
from ergon.workshop.models.pmpd.reading import is_list, is_patch, patch_refusal
from ergon.workshop.models.pmpd.reading import parse as pmpd_messages
from ergon.workshop.models.pmpd.score import score_text as pmpd_score_text
from ergon.workshop.models.pmpd.words import OBJECTS, Object
from ergon.workshop.models.sam.reading import parse as sam_sheet
from ergon.workshop.models.sam.reading import ports as sam_ports
from ergon.workshop.models.sam.score import score_text as sam_score_text
from ergon.workshop.models.sam.words import is_model as is_sam

Language = Literal["v1", "v2", "pmpd", "pmpd~", "sam", "miphysics"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions:
    """How a model is read.

    `dialect`: "v1" (MIMS), "v2" (mi-gen), "pmpd" or "pmpd~" (messages to an object of Pure
    Data), "sam" (Synth-A-Modeler), "miphysics" (its XML); by default the one that can read the
    model. `laws`: "head", as mi-gen has them today, or "2019". `values`: values of parameters by
    name; miPhysics has the value `rate` [Hz]. `inputs`: WAV files of 44,100 Hz, or "osc", by
    name.
    """

    dialect: Language | None = None
    laws: Laws = "head"
    values: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str | Path] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ImportedModel:
    """The text of a score, and what it was made from; `unfed` inputs have no file and stay at 0."""

    text: str
    dialect: Language
    n_statements: int
    unfed: tuple[str, ...] = ()


def is_model(text: str) -> bool:
    """Whether a text has the mark of a language that is read here, mistakes aside: for MIMS and
    mi-gen a line that begins with @ and a name.
    """
    kinds = (is_mims, is_table, is_patch, is_list, is_sam, is_miphysics)
    return any(matches(text) for matches in kinds)


def import_model(
    path: str | Path, options: ModelOptions = ModelOptions(), *, beside: str | Path = "."
) -> ImportedModel:
    """A model of another program as a score, which names files of inputs from the folder `beside`
    on.

    Raises ModelError with the line at fault, DialectError if two dialects can read the model and
    it sounds different in each, OptionError, and OSError.
    """
    path = Path(path)
    text = _read_model_text(path)
    if options.dialect is None and is_table(text):
        message = f"it is a table of resonances; `ergon bell {path.name}` makes an instrument of it"
        model_error = ModelError(message)
        model_error.file = str(path)
        raise model_error
    if options.dialect is None and is_patch(text):
        patch_error = ModelError(patch_refusal(text))
        patch_error.file = str(path)
        raise patch_error
    inputs = {name: _read_input(name, file, beside) for name, file in options.inputs.items()}

    dialect_name = options.dialect
    if dialect_name == "sam" or (dialect_name is None and is_sam(text)):
        try:
            return _import_sam(text, path.name, options, inputs)
        except ModelError as error:
            error.file = str(path)
            raise
    if dialect_name == "miphysics" or (dialect_name is None and is_miphysics(text)):
        try:
            return _import_miphysics(text, path.name, options)
        except ModelError as error:
            error.file = str(path)
            raise
    if dialect_name in OBJECTS or (dialect_name is None and is_list(text)):
        try:
            return _import_pmpd(text, path.name, options, inputs)
        except ModelError as error:
            error.file = str(path)
            raise
    dialect: Dialect
    dialect = (
        dialect_name
        if dialect_name == "v1" or dialect_name == "v2"
        else _find_dialect(text, path, options)
    )
    model = parse(text, dialect, str(path), options.values)
    unfed = _unfed_inputs(inputs, model.inputs)
    score = score_text(model, options.laws, inputs, path.name)
    return ImportedModel(score, dialect, len(model.statements), unfed)


def _read_model_text(path: Path) -> str:
    """The text of a model. Raises ModelError, also for a file of a program that is not read."""
    foreign_kind = foreign_file(path)
    try:
        text = read_text(path)
        if foreign_kind is None or is_model(text):
            return text
        error = ModelError(foreign_kind)
    except ModelError as not_text:
        error = not_text if foreign_kind is None else ModelError(foreign_kind)
    error.file = str(path)
    raise error


def _unfed_inputs(inputs: Mapping[str, Input], port_names: Sequence[str]) -> tuple[str, ...]:
    """Inputs of a model that no file feeds. Raises OptionError for an input that it does not
    have.
    """
    for name in inputs:
        if name not in port_names:
            suggestion = nearest(name, port_names)
            suggestion_text = f"; did you mean {suggestion}?" if suggestion else ""
            raise OptionError("feed", f"the model has no input {quote(name)}{suggestion_text}")
    return tuple(name for name in port_names if name not in inputs)


def _import_pmpd(
    text: str, name: str, options: ModelOptions, inputs: Mapping[str, Input]
) -> ImportedModel:
    """Messages to an object of Pure Data. Raises ModelError, DialectError and OptionError."""
    if options.values:
        raise OptionError("set", "models of pmpd have no parameters; leave this option out")
    if options.laws != "head":
        raise OptionError("laws", "the laws of 2019 are those of mi-gen")
    dialect: Object | None = None
    if options.dialect == "pmpd" or options.dialect == "pmpd~":
        dialect = options.dialect
    kind, messages = pmpd_messages(text, dialect)
    pmpd_network = network(kind, messages)
    input_names = {f"in{port.number}" for port in pmpd_network.ports if port.word.startswith("in")}
    unfed = _unfed_inputs(inputs, sorted(input_names))
    return ImportedModel(pmpd_score_text(pmpd_network, inputs, name), kind, len(messages), unfed)


def _import_sam(
    text: str, name: str, options: ModelOptions, inputs: Mapping[str, Input]
) -> ImportedModel:
    """A model of Synth-A-Modeler. Raises ModelError and OptionError."""
    if options.laws != "head":
        raise OptionError("laws", "the laws of 2019 are those of mi-gen")
    parameters = {}
    for parameter, parameter_value in options.values.items():
        try:
            parameters[parameter] = float(parameter_value)
        except ValueError:
            raise OptionError(
                "set", f"{parameter_value} is not a number", value=parameter
            ) from None
        if not isfinite(parameters[parameter]):
            raise OptionError("set", f"{parameter_value} is not a number", value=parameter)
    sheet = sam_sheet(text)
    unfed = _unfed_inputs(inputs, sam_ports(sheet))
    count = len(sheet.statements) + len(sheet.code)
    return ImportedModel(sam_score_text(sheet, inputs, parameters, name), "sam", count, unfed)


def _import_miphysics(text: str, name: str, options: ModelOptions) -> ImportedModel:
    """A model of miPhysics. Raises ModelError and OptionError."""
    if options.laws != "head":
        raise OptionError("laws", "the laws of 2019 are those of mi-gen")
    if options.inputs:
        raise OptionError("feed", "models of miPhysics have no inputs; leave this option out")
    rate = str(RATE)
    for parameter, parameter_value in options.values.items():
        if parameter != "rate":
            raise OptionError("set", f"the model has no parameter {quote(parameter)}; it has rate")
        rate = parameter_value
    if not (rate.isascii() and rate.isdigit() and RATES[0] <= int(rate[:9]) <= RATES[1]):
        least, highest = RATES
        raise OptionError("set", f"rate is a whole number from {least} to {highest:,} [Hz]")
    network = miphysics_network(text)
    count = len(network.masses) + len(network.links)
    return ImportedModel(miphysics_score_text(network, name, int(rate)), "miphysics", count)


def _find_dialect(text: str, path: Path, options: ModelOptions) -> Dialect:
    """The dialect that can read a model. Raises the ModelError of the dialect that got farther."""
    score_by_dialect: dict[Dialect, str] = {}
    error_by_dialect: dict[Dialect, ModelError] = {}
    for dialect in FORMS:
        try:
            model = parse(text, dialect, str(path), options.values)
            score_by_dialect[dialect] = _score_without_title(model, options.laws)
        except ModelError as error:
            error_by_dialect[dialect] = error
    # A value that is refused says nothing of the dialect.
    if not score_by_dialect and options.values:
        legible_dialects = [dialect for dialect in FORMS if _is_legible(text, dialect, path)]
        error_by_dialect = {
            dialect: error_by_dialect[dialect] for dialect in legible_dialects or error_by_dialect
        }
    if not score_by_dialect:
        farthest = max(
            error_by_dialect, key=lambda dialect: (error_by_dialect[dialect].line, dialect == "v2")
        )
        raise error_by_dialect[farthest]
    if len(set(score_by_dialect.values())) > 1:
        message = (
            f"both {' and '.join(DIALECT_NAMES.values())} read it, and it sounds otherwise in "
            "each; write --dialect v1 or --dialect v2"
        )
        dialect_error = DialectError(message)
        dialect_error.file = str(path)
        raise dialect_error
    return "v2" if "v2" in score_by_dialect else "v1"


def _is_legible(text: str, dialect: Dialect, path: Path) -> bool:
    """Whether a dialect reads a model with the values that it has."""
    try:
        parse(text, dialect, str(path), {})
    except ModelError:
        return False
    return True


def _score_without_title(model: Model, laws: Laws) -> str:
    """The score of a model without its first line, or the sentence that refuses it: equal texts
    mean the same in both dialects.
    """
    try:
        return score_text(model, laws).split("\n", 1)[1]
    except ModelError as error:
        return str(error)


def _read_input(name: str, file: str | Path, beside: str | Path) -> Input:
    """A file of one channel at the rate of models, or OSC. Raises OptionError."""
    if file == "osc":
        return OSC
    from ergon.exchange.sound import read_blocks, read_info
    from ergon.exchange.wave_header import NotWaveError

    path = Path(file)
    try:
        wave_info = read_info(path)
        is_fitting = (wave_info.format.rate, wave_info.format.n_channels) == (RATE, 1)
        blocks = [block[:, 0] for block in read_blocks(path)] if is_fitting else []
    except (NotWaveError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OptionError("feed", f"{file}: {reason}", value=name) from None
    if not is_fitting:
        message = (
            f"{file} has {wave_info.format.n_channels} channels at {wave_info.format.rate:,} Hz; "
        )
        message += f"a model is fed by one at {RATE:,} Hz"
        raise OptionError("feed", message, value=name)
    if wave_info.n_frames < 2:
        raise OptionError("feed", f"{file} has no sound", value=name)
    folder = Path(beside).resolve()
    if not path.resolve().is_relative_to(folder):
        message = f"{file} lies outside {folder}, and a score names files of its own folder"
        raise OptionError("feed", message, value=name)
    first_sample, second_sample = (float(value) for value in [*blocks[0][:2], *blocks[-1][-1:]][:2])
    sample_min = min(float(block.min()) for block in blocks)
    sample_max = max(float(block.max()) for block in blocks)
    if not isfinite(sample_min + sample_max):
        raise OptionError("feed", f"{file} has samples that are no numbers", value=name)
    file_of_score = path.resolve().relative_to(folder).as_posix()
    return Input(
        file_of_score, first_sample, second_sample, sample_min, sample_max, wave_info.n_frames
    )
