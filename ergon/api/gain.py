"""The gain of a performance: asked for, written in the score, or found by a preflight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log10
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .errors import OptionError

if TYPE_CHECKING:
    from ergon.exchange.frozen import VerifiedStem
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage


def parse_gain(gain_text: str) -> float:
    """The ratio of a level such as "-6dB". Raises OptionError."""
    from ergon.notation.tables.quantities import gain
    from ergon.notation.text.errors import TextError

    try:
        return gain(gain_text)
    except TextError as error:
        raise OptionError("gain", error.message) from None


def performance_gain(
    piece: Piece,
    make_stage: Callable[[], Stage],
    gain_text: str | None,
    report: Report,
    frozen_stems: Sequence[VerifiedStem] = (),
) -> float:
    """The gain (ratio): as asked; else as a preflight finds if the master asks for a peak or a
    loudness; else 1.

    `make_stage` returns the stage for the preflight. Raises OptionError.
    """
    from ergon.live.preflight import find_gain, preflight_frames

    if gain_text is not None:
        return parse_gain(gain_text)
    master = piece.mix.master
    if master is None or not master.is_levelled:
        return 1.0
    stage = make_stage()
    with report.progress("listening beforehand", preflight_frames(stage), stage.rate) as progress:
        # As in a file: peaks hold a loudness down unless the score limits them.
        master_options = {
            name: getattr(master, name) for name in ("normalise", "loudness", "limit")
        }
        played_level = replace(scores.played_level(piece), **master_options)
        gain_result = find_gain(stage, played_level, frozen_stems, progress.update)
    computed_span_text = (
        "the piece" if gain_result.seconds is None else f"its first {gain_result.seconds:.0f} s"
    )
    gain_in_db = f"{20 * log10(gain_result.gain):+.1f} dB"
    report.say(
        f"gain {gain_in_db}, from a preflight that computed {computed_span_text} unheard; --gain "
        "sets another"
    )
    return gain_result.gain
