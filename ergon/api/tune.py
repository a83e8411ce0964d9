"""Values of an instrument that bring its modes to frequencies that are asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.option import documented, option
from ergon.common.report import Report

from . import score as scores
from .errors import OptionError
from .options import ReadOptions
from .parts import frequency_option, link_elongations, selected_parts, stretches_no_spring

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.scores.edits.texts import Texts
    from ergon.scores.edits.tunable import FieldKey, TunablePart, TunableValue
    from ergon.scores.reading.load import Loaded

REACHED_CENTS = 1e-6  # [cents] within which a target counts as reached
_CENTS_TOLERANCE = 1e-10  # [cents] at which the search ends
_SIGNIFICANT_DIGITS = 12  # digits of a value; one more moves a mode by 1e-9 cents at most
_SEARCH_STEPS_MAX = 80
_LOG_STEP_MAX = 0.4  # a value is at most multiplied by e^0.4 in one step
_LOG_FACTOR_MAX = math.log(1000.0)
_LOG_NUDGE = 1e-4  # step of a value's logarithm for derivatives
_CENTS_PER_LOG = 1200.0 / math.log(2.0)
_SLOPE_RATIO_MIN = 1e-5  # a smaller slope is rounding, or tunes nothing
_FIELD_BY_WORD = {"masses": "M", "springs": "K", "pitches": "f"}


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class TuneOptions(ReadOptions):
    """Which values are changed to tune modes.

    "masses", "springs" and "pitches" mean "M", "K" and "f" of all modules of the part; without
    `by`, all fields that move its modes are changed. `base` is a number [Hz] or a text.
    """

    by: Sequence[str] = option(
        (),
        "Tune by these: masses, springs, pitches, a field (M) or a value (m1.M); repeatable.",
        metavar="VALUE",
    )
    base: float | str | None = option(
        None,
        "The frequency of ratio 1, such as A3; without it the first mode stays.",
        metavar="FREQUENCY",
    )


@dataclass(frozen=True, slots=True)
class TunedValue:
    """A value of the score: its name such as `bell.m.K`, its numbers before and after [SI], and
    `text`, the text to write.
    """

    name: str
    before: float
    after: float
    text: str


@dataclass(frozen=True, slots=True)
class Tuned:
    """Values that bring modes of a part to targets, or as near as can be.

    `modes` (n_targets,) are numbers of modes: 1 is the lowest that oscillates, and rigid motions
    of a free body do not count. `before`, `targets` and `frequencies` (n_targets,) [Hz] belong
    to these modes; `frequencies` are computed anew from the texts of the values. `values` are
    those that change. `rank` is the number of independent directions in which the values move
    the modes at the end. `edited` is the score's text with the new values; if it could not be
    written it is None, and `trouble` says why.
    """

    part: str
    modes: tuple[int, ...]
    before: NDArray[np.float64]
    targets: NDArray[np.float64]
    frequencies: NDArray[np.float64]
    values: tuple[TunedValue, ...]
    rank: int
    edited: str | None
    trouble: str
    inputs: tuple[Path, ...]

    @property
    def cents(self) -> NDArray[np.float64]:
        """How far above its target each mode lies [cents] (n_targets,)."""
        import numpy as np

        return 1200 * np.log2(self.frequencies / self.targets)

    @property
    def is_reached(self) -> bool:
        """Whether every target is reached within 1e-6 cents."""
        return bool(abs(self.cents).max() <= REACHED_CENTS)


def tune(
    score: str | Path,
    part: str,
    targets: str | Mapping[int, float | str] | Sequence[float | str],
    options: TuneOptions | None = None,
    *,
    report: Report | None = None,
) -> Tuned:
    """Values of a part of a score that bring its lowest modes to `targets`, changed least.

    `targets` are ratios ("1:2.76:5.4", "_" for a mode that is left alone); or frequencies [Hz]
    or texts such as "A3", for the modes from the lowest on; or a mapping from numbers of modes
    to these. The part is taken by itself, contacts open, laws at their slope at rest. Nothing is
    written. Raises ScoreError and OptionError.
    """
    import numpy as np

    from ergon.scores.edits.tunable import TunablePart

    options = options or TuneOptions()
    target_frequencies, has_ratios = _target_frequencies(targets, options.base)
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    (selected_name,) = selected_parts(piece, (part,))
    tuned_part = TunablePart(piece, selected_name)
    chosen = _chosen_values(tuned_part, options.by)
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("tuning"):
        if has_ratios:
            first_mode = next(iter(target_frequencies))
            base = (
                _Search(tuned_part, (), {first_mode: 1.0}).initial_frequencies[0]
                / target_frequencies[first_mode]
            )
            target_frequencies = {
                number: float(base * ratio) for number, ratio in target_frequencies.items()
            }
        search = _Search(tuned_part, chosen, target_frequencies)
        tuned_numbers = search.run()
    initial_frequencies = search.initial_frequencies
    tuned_values = [
        replace(value, number=number)
        for value, number in zip(search.values, tuned_numbers, strict=True)
    ]
    changed = [
        (old, new)
        for old, new in zip(search.values, tuned_values, strict=True)
        if old.number != new.number
    ]
    edited_texts, edit_trouble = _edited_texts(
        score, options, loaded, tuned_part, [new for _, new in changed]
    )
    frequencies = search.frequencies({value.field_key: value.number for value in tuned_values})
    if edited_texts is not None and (tuned_piece := edited_texts.load().piece) is not None:
        frequencies = _Search(
            TunablePart(tuned_piece, selected_name), (), target_frequencies
        ).initial_frequencies
    mode_numbers = tuple(target_frequencies)
    return Tuned(
        selected_name,
        mode_numbers,
        initial_frequencies,
        np.array(list(target_frequencies.values())),
        frequencies,
        tuple(
            TunedValue(tuned_part.target(new), old.number, new.number, tuned_part.value_text(new))
            for old, new in changed
        ),
        search.rank,
        None if edited_texts is None else edited_texts.text,
        edit_trouble,
        tuple(loaded.inputs),
    )


def _target_frequencies(
    target_texts: str | Mapping[int, float | str] | Sequence[float | str],
    base_pitch: float | str | None,
) -> tuple[dict[int, float], bool]:
    """Frequencies [Hz] by number of the mode; without a base, ratios and True."""
    if isinstance(target_texts, str) and ":" in target_texts:
        ratios_by_mode = {
            number: _parse_ratio(word)
            for number, word in enumerate(target_texts.split(":"), 1)
            if word.strip() != "_"
        }
        if len(ratios_by_mode) < (2 if base_pitch is None else 1):
            raise OptionError(
                "targets", f"'{target_texts}' is not a ratio; write for instance 1:2.76"
            )
        if base_pitch is None:
            return ratios_by_mode, True
        pitch = frequency_option("base", base_pitch)
        return {number: pitch * ratio for number, ratio in ratios_by_mode.items()}, False
    if base_pitch is not None:
        raise OptionError(
            "base", "a base is used with ratios only, such as 1:2.76:5.4; leave this option out"
        )
    if isinstance(target_texts, Mapping):
        numbered_targets = list(target_texts.items())
    else:
        listed_targets = target_texts.split() if isinstance(target_texts, str) else target_texts
        numbered_targets = [
            (n, target_text)
            for n, target_text in enumerate(listed_targets, 1)
            if target_text != "_"
        ]
    if not numbered_targets:
        raise OptionError(
            "targets", "no target is given; write ratios (1:2.76), frequencies or notes"
        )
    hertz_by_mode = {}
    for mode_number, target_text in sorted(numbered_targets):
        if mode_number < 1:
            raise OptionError("targets", f"there is no mode {mode_number}; modes count from 1")
        hertz_by_mode[mode_number] = frequency_option("targets", target_text)
    if any(
        a >= b
        for a, b in zip(
            list(hertz_by_mode.values()), list(hertz_by_mode.values())[1:], strict=False
        )
    ):
        raise OptionError(
            "targets", "the targets must rise from mode to mode, because modes count by their pitch"
        )
    return hertz_by_mode, False


def _parse_ratio(ratio_word: str) -> float:
    try:
        ratio_value = float(ratio_word)
    except ValueError:
        ratio_value = math.nan
    if not 0 < ratio_value < math.inf:
        reason = f"'{ratio_word}' is not a ratio above 0; write for instance 1:2.76:5.4"
        raise OptionError("targets", reason)
    return ratio_value


def _chosen_values(tunable_part: TunablePart, target_names: Sequence[str]) -> list[TunableValue]:
    """The values that `target_names` names. Raises OptionError."""
    from ergon.notation.text.spelling import nearest

    part_values = list(tunable_part.values())
    if not part_values:
        raise OptionError("part", f"{tunable_part.name} has no value above 0 that moves its modes")
    if not target_names:
        return part_values
    values_by_name: dict[str, list[TunableValue]] = {}
    for part_value in part_values:
        full_name = tunable_part.target(part_value)
        value_words = [part_value.field, tunable_part.field_name(part_value), full_name]
        value_words += [word.removeprefix(f"{tunable_part.name}.") for word in value_words[1:]]
        for name in dict.fromkeys(value_words):
            values_by_name.setdefault(name, []).append(part_value)
    chosen_values: dict[TunableValue, None] = {}
    for target_word in target_names:
        matches = values_by_name.get(_FIELD_BY_WORD.get(target_word, target_word))
        if matches is None:
            value_words = [
                word for word, field in _FIELD_BY_WORD.items() if field in values_by_name
            ]
            nearest_name = nearest(target_word, [*values_by_name, *value_words])
            hint = (
                f"did you mean '{nearest_name}'?"
                if nearest_name
                else f"there are {', '.join(values_by_name)}"
            )
            raise OptionError(
                "by", f"{tunable_part.name} has no value '{target_word}' above 0; {hint}"
            )
        chosen_values.update(dict.fromkeys(matches))
    return list(chosen_values)


def _edited_texts(
    score: str | Path,
    tune_options: TuneOptions,
    loaded: Loaded,
    tunable_part: TunablePart,
    tuned_values: Sequence[TunableValue],
) -> tuple[Texts | None, str]:
    """The texts with the values in them; or why they could not be written."""
    from ergon.notation.text.edit import EditError
    from ergon.scores.edits.texts import Texts

    path = str(Path(score))
    edited_texts = Texts(
        path, loaded.files[path].text, bounds=scores.bounds(path, tune_options.trust)
    )
    edited_texts = original_texts = edited_texts.complete()
    try:
        edited_texts = tunable_part.with_values(edited_texts, tuned_values)
    except EditError as error:
        return None, str(error)
    linked_files = [
        file
        for file, text in edited_texts.overlay.items()
        if original_texts.overlay.get(file) != text
    ]
    if linked_files:
        file_list = ", ".join(linked_files)
        return (
            None,
            f"{tunable_part.name} is written in {file_list}, which other scores may use: set it "
            "there",
        )
    return edited_texts, ""


class _Search:
    """Gauss-Newton with steps of least change in the logarithms of the values.

    Derivatives are those of the poles: (s²M + sZ + K) x = 0 gives ds = -xᵀ(s²·dM + s·dZ + dK)x /
    xᵀ(2sM + Z)x (Fox & Kapoor 1968, with damping).
    """

    def __init__(
        self,
        part: TunablePart,
        values: Sequence[TunableValue],
        target_frequencies: Mapping[int, float],
    ) -> None:
        import numpy as np

        self.part, self.target_frequencies = part, target_frequencies
        self.values: list[TunableValue] = []
        self.log_targets = np.log(list(target_frequencies.values()))
        self.rank = 0
        poles, shapes, elements = self._modes({})
        self.initial_frequencies = poles.imag / (2 * np.pi)
        # Values that no mode depends on are left out.
        for tuned_value in values:
            slope = self._slope(poles, shapes, elements, tuned_value, tuned_value.number, {})
            if np.abs(slope).max() > _SLOPE_RATIO_MIN:
                self.values.append(tuned_value)
        if values and not self.values:
            names = ", ".join(part.target(value) for value in values)
            raise OptionError("by", f"no mode depends on {names}; name others, or leave `by` out")

    def frequencies(self, values: Mapping[FieldKey, float]) -> NDArray[np.float64]:
        """Frequencies of the modes that have targets [Hz]."""
        import numpy as np

        return np.asarray(self._modes(values)[0].imag / (2 * np.pi))

    def run(self) -> list[float]:
        """The values that bring the modes nearest to their targets."""
        import numpy as np

        initial_logs = np.log([value.number for value in self.values])
        logs, error_max = initial_logs.copy(), math.inf
        search_state = self._modes(self._numbers(logs))
        for _ in range(_SEARCH_STEPS_MAX):
            poles = search_state[0]
            residuals = np.log(poles.imag / (2 * np.pi)) - self.log_targets
            error_max = float(np.abs(residuals).max())
            slopes = self._slopes(search_state, logs)
            log_step, self.rank = _least_step(slopes, residuals)
            if error_max * _CENTS_PER_LOG <= _CENTS_TOLERANCE:
                break
            largest_step = float(np.abs(log_step).max())
            if largest_step <= 1e-15:
                break
            log_step *= min(1.0, _LOG_STEP_MAX / largest_step)
            accepted_step = self._improved_step(
                logs, initial_logs, log_step, float(residuals @ residuals)
            )
            if accepted_step is None:
                break
            logs, search_state = accepted_step
        return [
            value.number
            if log_value == initial_log
            else float(f"{math.exp(log_value):.{_SIGNIFICANT_DIGITS}g}")
            for value, log_value, initial_log in zip(self.values, logs, initial_logs, strict=True)
        ]

    def _improved_step(
        self,
        logs: NDArray[np.float64],
        initial_logs: NDArray[np.float64],
        log_step: NDArray[np.float64],
        error_square: float,
    ) -> tuple[NDArray[np.float64], _State] | None:
        """The step, or a shorter one, that reduces the error; None if none does."""
        import numpy as np

        from ergon import _core

        for _ in range(14):
            trial_logs = np.clip(
                logs + log_step, initial_logs - _LOG_FACTOR_MAX, initial_logs + _LOG_FACTOR_MAX
            )
            try:
                trial_state = self._modes(self._numbers(trial_logs))
            except _core.EngineError:  # values that no module allows: try a shorter step
                log_step = log_step / 2
                continue
            residuals = np.log(trial_state[0].imag / (2 * np.pi)) - self.log_targets
            if float(residuals @ residuals) < error_square * (1 - 1e-9):
                return trial_logs, trial_state
            log_step = log_step / 2
        return None

    def _numbers(self, logs: NDArray[np.float64]) -> dict[FieldKey, float]:
        import numpy as np

        return {
            value.field_key: float(np.exp(log_value))
            for value, log_value in zip(self.values, logs, strict=True)
        }

    def _modes(self, values: Mapping[FieldKey, float]) -> _State:
        """Poles (n_targets,) and shapes (n_targets, n_masses) of the modes that have targets."""
        import numpy as np

        from ergon import _core

        network = self.part.network(values)
        elements = network.elements([self.part.name])
        n_mats, last_mode = len(elements.mats), max(self.target_frequencies)
        n_modes = last_mode + 2
        while True:
            try:
                part_modes = network.part_modes(self.part.name, count=n_modes)
            except _core.EngineError as error:
                raise OptionError("targets", str(error)) from None
            oscillating_indices = np.flatnonzero(
                (part_modes.poles.imag > 0) & ~stretches_no_spring(part_modes.shapes, elements)
            )
            if len(oscillating_indices) >= last_mode or n_modes >= n_mats:
                break
            n_modes = min(n_mats, 2 * n_modes)
        if len(oscillating_indices) < last_mode:
            mode_count_text = (
                f"{len(oscillating_indices)} modes that swing"
                if len(oscillating_indices) != 1
                else "1 mode that swings"
            )
            reason = f"mode {last_mode} is wanted, but {self.part.name} has {mode_count_text}"
            raise OptionError("targets", reason)
        mode_indices = oscillating_indices[np.array(list(self.target_frequencies)) - 1]
        return part_modes.poles[mode_indices], part_modes.shapes[mode_indices], elements

    def _slopes(self, state: _State, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivatives of ln f by the logarithm of each value (n_targets, n_values)."""
        import numpy as np

        numbers = self._numbers(logs)
        slope_columns = [
            self._slope(*state, value, numbers[value.field_key], numbers) for value in self.values
        ]
        return np.column_stack(slope_columns)

    def _slope(
        self,
        poles: NDArray[np.complex128],
        shapes: NDArray[np.complex128],
        elements: _core.Elements,
        tunable: TunableValue,
        number: float,
        numbers: Mapping[FieldKey, float],
    ) -> NDArray[np.float64]:
        import numpy as np

        from ergon import _core

        def elements_with(factor: float) -> _core.Elements:
            network = self.part.network({**numbers, tunable.field_key: number * factor})
            return network.elements([self.part.name])

        try:
            modes_above, modes_below = (
                elements_with(math.exp(_LOG_NUDGE)),
                elements_with(math.exp(-_LOG_NUDGE)),
            )
        except _core.EngineError:  # the value is at the limit of its range, and stays
            return np.zeros(len(poles))
        dm, dk, dz = (
            (getattr(modes_above, name) - getattr(modes_below, name)) / (2 * _LOG_NUDGE)
            for name in ("masses", "stiffness", "damping")
        )
        is_contact = np.array([kind == "BUT" for kind in elements.kinds])
        squared_stretches = np.where(is_contact, 0.0, link_elongations(shapes, elements) ** 2)
        rate, k, z = elements.ca_rate, elements.stiffness, elements.damping
        pole_steps = poles if rate is None else np.exp(poles / rate) - 1
        if rate is not None:
            k_z, dz = k + z, dz + dk  # w² + (Z + K) w + K = 0 at w = z - 1
        else:
            k_z = z
        squared_shapes = shapes**2
        perturbation = (
            pole_steps**2 * (squared_shapes @ dm)
            + pole_steps * (squared_stretches @ dz)
            + squared_stretches @ dk
        )
        ds = -perturbation / (
            2 * pole_steps * (squared_shapes @ elements.masses) + squared_stretches @ k_z
        )
        if rate is not None:
            ds = rate * ds / (1 + pole_steps)
        return np.asarray(ds.imag / poles.imag)


def _least_step(
    slopes: NDArray[np.float64], residuals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int]:
    """The smallest step that minimises the error for these slopes, and their rank."""
    import numpy as np

    left_vectors, singular_values, right_vectors = np.linalg.svd(slopes, full_matrices=False)
    sensitive = singular_values > _SLOPE_RATIO_MIN
    weights = (left_vectors.T @ -residuals)[sensitive] / singular_values[sensitive]
    return np.asarray(right_vectors[sensitive].T @ weights), int(sensitive.sum())


if TYPE_CHECKING:
    _State = tuple[NDArray[np.complex128], NDArray[np.complex128], _core.Elements]
