"""A sound file of many channels folded to others: two ears, stereo, Ambisonics, another room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.common.option import renamed
from ergon.common.report import Report
from ergon.exchange.wave_header import ORIGINATOR, Bits, NotWaveError
from ergon.rendering.loudness import gain_to_peak

from .errors import OptionError
from .gain import parse_gain
from .options import PerformanceOptions

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.exchange.wave_header import WaveFormat, WaveInfo
    from ergon.instruments.model import Layout
    from ergon.scores.reading.piece import Piece
    from ergon.space.fold_filters import Field
    from ergon.space.head import Head

_AMBISONICS_PREFIX = "ambix"
_BLOCK_FRAMES = 65_536  # frames
_BITS_TO_WRITE: dict[Bits, Bits] = {
    8: 16,
    32: "float",
    "double": "float",
}  # formats that can be read only, and their replacement


class FoldError(ErgonError, ValueError):
    """The file cannot be folded; the message says why, and what to do."""


@renamed(from_="layout")
@dataclass(frozen=True, slots=True, kw_only=True)
class FoldOptions:
    """How a file is folded.

    `layout`: the layout, or the order of Ambisonics, that the file holds; by default as the file
    says (ADM). `head`: a SOFA file in place of the head that ships. `gain` in decibels, such as
    "-6dB"; without it a fold that would clip is turned down. `bits`: 16, 24 or "float"; by default
    those of the file.
    """

    layout: str | None = None
    head: str | Path | None = None
    gain: str | None = None
    bits: Bits | None = None
    force: bool = False


@dataclass(frozen=True, slots=True)
class Folded:
    """What was written: its peak and true peak as ratios of full scale, and the ratio by which all
    channels were multiplied.
    """

    path: str
    n_channels: int
    n_frames: int
    rate: int
    peak: float
    true_peak: float
    gain: float
    sha256: str


def fold_file(
    source: str | Path,
    out: str | Path,
    to: str,
    options: FoldOptions | None = None,
    *,
    report: Report | None = None,
) -> Folded:
    """Fold a WAV, FLAC or AIFF file into another; the same input gives the same bytes.

    `to`: binaural, stereo, ambix1 to ambix7, or a layout (a file, or one that ships).
    Raises FoldError, NoLayoutError, ScoreError (a layout with mistakes), OptionError,
    FileRefusedError, and OSError where the file cannot be read.
    """
    import numpy as np

    from ergon import _core
    from ergon.exchange import sound
    from ergon.exchange.safe import check_target, open_for_writing
    from ergon.exchange.wave_header import Stamp, WaveFormat
    from ergon.rendering.level import FrameSpool

    from .layouts import layout_chunks

    report, path, target = report or Report(), Path(source), str(out)
    options = options or FoldOptions()
    try:
        wave_info = sound.read_info(path)
    except NotWaveError as error:
        raise FoldError(f"{path}: {error}") from None
    input_files = (path, *([Path(options.head)] if options.head else []))
    if target != "-":
        check_target(Path(target), force=options.force, inputs=input_files)
    source_field, field_effects, gains = _source_field(path, wave_info, options, report)
    filters, target_field = _fold_filters(
        source_field, (to, options.head), wave_info.format.rate, report
    )
    filters = _filters_with_silent_channels(field_effects, filters)
    if gains:
        filters = np.ascontiguousarray(filters * np.array(gains)[:, np.newaxis, np.newaxis])
    bits: Bits = options.bits or _BITS_TO_WRITE.get(wave_info.format.bits, wave_info.format.bits)
    if wave_info.damage is not None:
        report.warn(f"{path}: {wave_info.damage}")
    target_format = WaveFormat(wave_info.format.rate, filters.shape[1], bits)
    sound.check_format(target, target_format)
    fold = _core.Fold(filters)
    n_frames = wave_info.n_frames + fold.tail
    title = wave_info.title if wave_info.originator == ORIGINATOR else path.stem
    chunks = b"" if target_field is None else layout_chunks(target_field, title)
    wave_stamp = Stamp(title, chunks=chunks)
    folder = None if target == "-" else Path(target).resolve().parent
    with (
        open_for_writing(target, binary=True, force=options.force, inputs=input_files) as file,
        FrameSpool(folder, target_format.n_channels) as frame_spool,
        report.progress("folding", n_frames, target_format.rate) as progress,
    ):
        true_peak, n_folded = _core.TruePeak(target_format.n_channels), 0
        blocks = _blocks_with_tail(path, wave_info, sound.read_blocks(path), fold.tail)
        for block in _folded_blocks(blocks, fold, target_format.n_channels):
            frame_spool.take(block)
            true_peak.process(block)
            n_folded += len(block)
            progress.update(n_folded)
        gain = _fold_gain(options, target_format, frame_spool.peak, true_peak.peak)
        writer = sound.writer(target, file, target_format, n_frames, wave_stamp)
        for block in frame_spool.blocks(_BLOCK_FRAMES):
            if target_format.bits == "float":
                writer.write(_core.single(block * gain, 1.0))  # type: ignore[arg-type]
            else:
                writer.write(_core.pcm(block * gain, 1.0, 16 if target_format.bits == 16 else 24))
        writer.close()
    peaks = frame_spool.peak * gain, true_peak.peak * gain
    return Folded(
        target, target_format.n_channels, n_frames, target_format.rate, *peaks, gain, writer.sha256
    )


def _fold_gain(
    fold_options: FoldOptions, format: WaveFormat, peak: float, true_peak: float
) -> float:
    """The gain (a ratio) of a fold: as asked, or less where it would clip. Raises OptionError."""
    gain = 1.0 if fold_options.gain is None else parse_gain(fold_options.gain)
    if format.bits == "float" or gain * peak <= 1.0:
        return gain
    if fold_options.gain is None:
        return gain_to_peak(true_peak)
    raise OptionError(
        "gain",
        f"the fold would clip: its peak would be {20.0 * log10(gain * peak):+.1f} dBFS; the "
        f"most is {-20.0 * log10(peak):.2f} dB in {format.bits} bits. Leave the option out, and "
        "the fold is turned down as far as it must be, or write floats",
        value=fold_options.gain,
    )


def fold_of(
    piece: Piece, options: PerformanceOptions, report: Report | None = None
) -> _core.Fold | None:
    """The fold through which a performance is heard; None if its own channels are heard.

    Raises OptionError, NoLayoutError, ScoreError (a layout with mistakes), FoldError and
    OSError.
    """
    from ergon import _core

    if options.to is None:
        if options.head is not None:
            raise OptionError(
                "head", "a head is used by `--to binaural` only; leave this option out"
            )
        return None
    layout = piece.mix.layout
    if layout is None:
        reason = "the score does not say where its loudspeakers are: write `mix: {layout: …}` in it"
        raise OptionError("to", reason, value=options.to)
    target = options.to, options.head
    filters, _ = _fold_filters(_speakers_by_channel(layout), target, piece.rate, report or Report())
    return _core.Fold(
        _filters_with_silent_channels(
            layout.channels_without_loudspeaker(piece.mix.channels), filters
        )
    )


def _folded_blocks(
    blocks: Iterator[NDArray[np.float64]], fold: _core.Fold, n_channels: int
) -> Iterator[NDArray[np.float64]]:
    """The folded blocks, each a new array."""
    import numpy as np

    for block in blocks:
        folded_block = np.zeros((len(block), n_channels))
        fold.process(block, folded_block)
        yield folded_block


def _blocks_with_tail(
    path: Path, wave_info: WaveInfo, blocks: Iterator[NDArray[np.float64]], n_tail: int
) -> Iterator[NDArray[np.float64]]:
    """The blocks of a file, then zeros for the tail of the fold. Raises FoldError for infinite
    samples.
    """
    import numpy as np

    n_frames_read = 0
    try:
        for block in blocks:
            if not np.isfinite(block).all():
                raise FoldError(
                    f"{path} holds samples that are not finite, after frame {n_frames_read:,}"
                )
            n_frames_read += len(block)
            yield np.ascontiguousarray(block)
    except NotWaveError as error:
        raise FoldError(f"{path}: {error}") from None
    yield np.zeros((n_tail, wave_info.format.n_channels))


def _ambisonics_order(layout_word: str, option: str) -> int | None:
    """The order of `ambix5`; None for another word. Raises OptionError."""
    from ergon.space.ambisonics import ORDER_MAX

    if not layout_word.startswith(_AMBISONICS_PREFIX) or Path(layout_word).suffix:
        return None
    digits = layout_word.removeprefix(_AMBISONICS_PREFIX)
    if digits not in map(str, range(1, ORDER_MAX + 1)):
        reason = f"the order of Ambisonics is 1 to {ORDER_MAX}, such as {_AMBISONICS_PREFIX}5"
        raise OptionError(option, reason, value=layout_word)
    return int(digits)


def _speakers_by_channel(layout: Layout) -> Field:
    """The loudspeakers of a layout in the order of their channels."""
    from ergon.space.fold_filters import Field

    placed_speakers = sorted(zip(layout.channels, layout.speakers, strict=True))
    return Field(tuple(place for _, place in placed_speakers))


def _field_of_word(
    field_word: str, option_name: str, report: Report
) -> tuple[Field, tuple[int, ...]]:
    """The field that a word names: an order of Ambisonics, or the loudspeakers of a layout; and the
    channels, from 0, that lie between those of the field.
    """
    from ergon.space.ambisonics import ORDER_MAX
    from ergon.space.fold_filters import Field

    from .layouts import NoLayoutError, read_layout

    order = _ambisonics_order(field_word, option_name)
    if order is not None:
        return Field(order=order), ()
    try:
        layout = read_layout(field_word, report)
        return _speakers_by_channel(layout), layout.channels_without_loudspeaker(layout.n_channels)
    except NoLayoutError as error:
        raise OptionError(
            option_name, f"{error}, or {_AMBISONICS_PREFIX}1 to {_AMBISONICS_PREFIX}{ORDER_MAX}"
        ) from None


def _filters_with_silent_channels(
    left_out: tuple[int, ...], filters: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The filters of all channels, of which the others are not heard."""
    if not left_out:
        return filters
    import numpy as np

    padded_filters = np.zeros((len(filters) + len(left_out), *filters.shape[1:]))
    padded_filters[
        [
            channel_index
            for channel_index in range(len(padded_filters))
            if channel_index not in left_out
        ]
    ] = filters
    return padded_filters


def _source_field(
    path: Path, wave_info: WaveInfo, fold_options: FoldOptions, report: Report
) -> tuple[Field, tuple[int, ...], tuple[float, ...]]:
    """What the channels of a file are: as `fold_options` say, or else as the file says; which of
    them, from 0, are for low-frequency effects or no loudspeakers; and the factors of all, empty
    where each is 1. Raises FoldError.
    """
    from ergon.common.xml_text import XmlError
    from ergon.exchange import adm
    from ergon.space.directions import point
    from ergon.space.fold_filters import Field

    channel_kind = "for low-frequency effects"
    gains: tuple[float, ...] = ()
    if fold_options.layout is not None:
        field_names, effects = _field_of_word(fold_options.layout, "layout", report)
        channel_kind = "not among the loudspeakers of the layout"
    else:
        unknown_reason = "it does not say what its channels are"
        try:
            adm_field = adm.read(wave_info)
        except XmlError as error:
            adm_field, unknown_reason = None, str(error)
        if adm_field is None:
            raise FoldError(f"{path}: {unknown_reason}; name them, such as by --layout dome24")
        field_names = Field(tuple(point(*angles) for angles in adm_field.speakers), adm_field.order)
        effects, gains = adm_field.effects, adm_field.gains
        for note in adm_field.notes:
            report.warn(f"{path}: {note}")
    if field_names.n_channels + len(effects) != wave_info.format.n_channels:
        channel_text = f"{fold_options.layout or 'its description'} has {field_names.n_channels}"
        raise FoldError(f"{path} has {wave_info.format.n_channels} channels, but {channel_text}")
    if effects:
        *first_channels, last_channel = (str(channel + 1) for channel in effects)
        warning = f"channel {last_channel} is {channel_kind}, and is left out"
        if first_channels:
            warning = (
                f"channels {', '.join(first_channels)} and {last_channel} are {channel_kind}, and "
                "are left out"
            )
        report.warn(f"{path}: {warning}")
    return field_names, effects, gains


def _fold_filters(
    source_field: Field, target_and_head: tuple[str, str | Path | None], rate: float, report: Report
) -> tuple[NDArray[np.float64], Field | None]:
    """Filters (n_in, n_out, n_taps), and the target if it is a field, not stereo or two ears.

    `target_and_head`: the name of the target, and the SOFA file of a head.
    """
    import numpy as np

    from ergon.space import fold_filters, head
    from ergon.space.panning import ArrayError

    to, sofa = target_and_head
    if sofa is not None and to != "binaural":
        raise OptionError("head", "a head is used by `--to binaural` only; leave this option out")
    if to == "stereo":
        return fold_filters.to_stereo(source_field), None
    if to == "binaural":
        head_responses = head.kemar() if sofa is None else _head_of_file(sofa, source_field)
        return fold_filters.to_ears(source_field, head_responses, rate), None
    target_field, left_out = _field_of_word(to, "to", report)
    try:
        filters = fold_filters.to_field(source_field, target_field)
        if left_out:
            filters_by_channel = _filters_with_silent_channels(
                left_out, filters.transpose(1, 0, 2)
            ).transpose(1, 0, 2)
            return np.ascontiguousarray(filters_by_channel), None
        return filters, target_field
    except ArrayError as error:
        raise OptionError("to", str(error), value=to) from None


def _head_of_file(path: str | Path, source_field: Field) -> Head:
    """The head of a SOFA file, for the directions of a field."""
    from ergon.exchange import sofa
    from ergon.space import fold_filters, head
    from ergon.space.directions import point, unit_vectors

    measured_head = sofa.read(Path(path))
    directions = unit_vectors(
        point(azimuth, elevation, 1.0) for azimuth, elevation in measured_head.angles.tolist()
    )
    source_directions = fold_filters.directions_of(source_field)
    return head.prepared(
        directions,
        measured_head.responses,
        measured_head.rate,
        source_directions,
        measured_head.delays,
    )
