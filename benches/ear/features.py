"""The figures by which sounds are compared: their names, groups and scales."""

from __future__ import annotations

from dataclasses import dataclass

OCTAVES = (63, 125, 250, 500, 1000, 2000, 4000, 8000, 16000)  # centres [Hz]
WINDOWS = {"a": "0-50 ms", "b": "0-0.5 s", "c": "0.5-1.5 s"}  # after the onset
REGIONS = {"lo": "< 1 kHz", "mid": "1-4 kHz", "hi": "> 4 kHz"}
FLOOR = -60.0  # [dB]: what lies below it is not compared


@dataclass(frozen=True, slots=True)
class Feature:
    """A figure: its group, what it is in words, the base of its logarithm (0: none), and bounds
    beyond which nobody hears a difference.
    """

    group: str
    words: str
    base: int = 0
    low: float | None = None
    high: float | None = None

    def plain(self, value: float) -> float:
        """The figure in the unit of its words."""
        return float(self.base**value) if self.base else value


def _features() -> dict[str, Feature]:
    table = {
        "att": Feature("attack", "rise 10-90 % [s]", 10),
        "tpeak": Feature("attack", "time of the peak [s]", 10),
        "burst": Feature("attack", "first 20 ms over 100-200 ms [dB]"),
        "crest": Feature("attack", "crest of the first 50 ms [dB]"),
        "tcent": Feature("attack", "centre of time [s]", 10),
    }
    for w, when in WINDOWS.items():
        table |= {
            f"{w}_cent": Feature("spectrum", f"centre of the spectrum, {when} [Hz]", 2),
            f"{w}_spread": Feature("spectrum", f"spread, {when} [octaves]"),
            f"{w}_roll95": Feature("spectrum", f"95 % of energy below, {when} [Hz]", 2),
            f"{w}_roll99": Feature("spectrum", f"99 % of energy below, {when} [Hz]", 2),
            f"{w}_hi4": Feature("spectrum", f"above 4 kHz, {when} [dB]", low=FLOOR),
            f"{w}_hi8": Feature("spectrum", f"above 8 kHz, {when} [dB]", low=FLOOR),
        }
    for w in "ab":
        for f in OCTAVES:
            words = f"octave {f} Hz, {WINDOWS[w]} [dB]"
            table[f"{w}_{f}"] = Feature("bands", words, low=FLOOR)
    for w, when in WINDOWS.items():
        table[f"{w}_flat"] = Feature("noise", f"flatness, {when} [dB]", low=-35.0)
    for r, where in REGIONS.items():
        table[f"tnr_{r}"] = Feature("noise", f"partials over noise, {where} [dB]", high=35.0)
    for r, where in REGIONS.items():
        table[f"gap_{r}"] = Feature("noise", f"floor between partials, {where} [dB]", low=FLOOR)
    table |= {
        "hnr": Feature("noise", "periodicity [dB]", high=30.0),
        "n60": Feature("partials", "partials within 60 dB", 2),
        "n40": Feature("partials", "partials within 40 dB", 2),
        "top": Feature("partials", "highest partial [Hz]", 2),
        "dens24": Feature("partials", "partials in 2-4 kHz", 2),
        "dens48": Feature("partials", "partials in 4-8 kHz", 2),
        "fmax": Feature("partials", "strongest partial [Hz]", 2),
        "ratio2": Feature("partials", "second strongest to strongest [octaves]"),
    }
    for f in OCTAVES[1:8]:
        table[f"t60_{f}"] = Feature("decay", f"T60 of the octave {f} Hz [s]", 10)
    return table | {
        "t60_med": Feature("decay", "median T60 of partials [s]", 10),
        "t60_slope": Feature("decay", "change of T60 an octave up [octaves]"),
        "t60_scatter": Feature("decay", "scatter of T60 about that line [octaves]"),
        "early": Feature("decay", "fall in 20-150 ms [dB/s]"),
        "late": Feature("decay", "fall in 0.5-1.5 s [dB/s]"),
        "slopes": Feature("decay", "early fall over late fall (log2)"),
        "slopes_p": Feature("decay", "the same, of single partials"),
        "beat": Feature("motion", "beating of partials [dB]", low=0.1),
        "wobble": Feature("motion", "unsteadiness of the level [dB]", low=0.1),
        "jitter": Feature("motion", "unsteadiness of pitch [cents]", 10, low=0.0),
        "chirp": Feature("motion", "pitch at 30 ms over pitch at 300 ms [cents]"),
    }


FEATURES = _features()
NAMES = tuple(FEATURES)
GROUPS = tuple(dict.fromkeys(feature.group for feature in FEATURES.values()))
