"""Measured cards of the instruments in `instruments/library`, for `docs/instruments`.

Each instrument that `cards.yaml` names plays soft, middle and hard, by itself. The measurements
of the sounds become rows of `cards.csv`, a page for each family, and a picture.
"""

from __future__ import annotations

import csv
import re
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from docs.generators.noise_level import noise_level, stands_out
from docs.generators.spectra import spectrogram
from docs.generators.wrap import wrapped
from ergon.common.module_arguments import module_arguments
from ergon.instruments.kinds.outputs import OUTPUTS
from ergon.notation.tables.notes import nearest_note
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

Samples = NDArray[np.float64]

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
BESIDE = ROOT / "scores" / "library" / "card.yaml"  # where such a score would lie
STROKES = ("soft", "middle", "hard")
SECONDS = 1.5  # of each stroke, which falls at 50 ms
_SPECTRUM_SECONDS = 0.55  # s, in which spectra are taken
_FLOOR = -60.0  # dB below the strongest partial
_TAIL = 0.35  # s after the beginning: no mallet touches any more


@dataclass(frozen=True)
class Mode:
    """A partial: its frequency [Hz], level below the strongest [dB], T60 [s] or nan."""

    f: float
    level: float
    t60: float


@dataclass(frozen=True)
class Figures:
    """Measured figures of an instrument; frequencies in Hz, levels in dB."""

    family: str
    name: str
    strongest: float
    soft: float
    middle: float
    hard: float
    partials: int
    highest: float
    loudness: float
    treble: float
    click: float
    mean_level: float


@dataclass(frozen=True)
class Card:
    """Figures, strongest modes of the hard stroke, and the sounds (three, n_frames)."""

    figures: Figures
    modes: tuple[Mode, ...]
    sounds: Samples
    rate: float


def described() -> dict[str, dict[str, Any]]:
    """`cards.yaml`: families, each with its title and its cards."""
    text = (HERE / "cards.yaml").read_text(encoding="utf-8")
    read: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return read


def score(
    family: str, name: str, card: dict[str, Any], tail: float = SECONDS, rubbed: float = 2.0
) -> str:
    """A score that plays the instrument soft, middle and hard, each into a channel of its own.

    `tail` is how long it sounds after a strike, `rubbed` how long a bow moves or a note lasts [s].
    """
    lines = ["ergon: 1", f"use: [instruments/{family}.yaml]"]
    if "play" in card:
        lines += ["instruments:"]
        lines += [f"  {stroke_name}: {{like: {name}}}" for stroke_name in STROKES]
        lines += ["strikes:"]
        for stroke_name, strength in zip(STROKES, card["play"].split(), strict=True):
            note = f"{{rhythm: {stroke_name}, at: 50ms, cycle: {rubbed:g}s, times: 1"
            lines.append(f"  s-{stroke_name}: {note}, impulse: {strength}}}")
    elif "strike" in card:
        lines += [
            "instruments:",
            *(f"  {stroke_name}: {{like: {name}}}" for stroke_name in STROKES),
            "strikes:",
        ]
        for stroke_name, impulse in zip(STROKES, card["impulse"].split(), strict=True):
            to = ", ".join(f"{stroke_name}.{target}" for target in card["strike"].split())
            lines.append(f"  s-{stroke_name}: {{to: [{to}], at: 50ms, impulse: {impulse}}}")
    else:
        keys = [f"  k-{stroke_name}: {{M: 200g, K: 0.5N/m, Z: 0.2Ns/m}}" for stroke_name in STROKES]
        lines += ["keys:", *keys, "instruments:"]
        for stroke_name in STROKES:
            hair = f"{{LNL: {{between: [k-{stroke_name}, {card['bow']}], {card['law']}}}}}"
            lines.append(f"  {stroke_name}: {{from: {family}/{name}, modules: {{hair: {hair}}}}}")
        lines += [
            "players:",
            *(f"  p-{stroke_name}: {{key: k-{stroke_name}}}" for stroke_name in STROKES),
            "gestures:",
        ]
        for stroke_name, speed in zip(STROKES, card["speed"].split(), strict=True):
            lines.append(f"  g-{stroke_name}: 0mm@0 line {rubbed * float(speed):g}mm@{rubbed:g}s")
        parts = [
            f"  p-{stroke_name}: [{{at: 0, play: g-{stroke_name}, touch: tracked}}]"
            for stroke_name in STROKES
        ]
        lines += ["parts:", *parts]
    routes = ", ".join(
        f"{{from: {stroke_name}, to: {i}}}" for i, stroke_name in enumerate(STROKES, 1)
    )
    lines += [f"mix: {{channels: 3, route: [{routes}]}}", f"render: {{tail: {tail}s}}"]
    return "\n".join(lines) + "\n"


def play(text: str, seconds: float) -> tuple[Samples, float]:
    """The beginning of a score, (n_channels, n_frames) before any gain, and the rate."""
    loaded = load(BESIDE, text=text)
    if loaded.piece is None:
        raise ValueError(str(loaded.diagnostics))
    staged = stage(loaded.piece)
    n_frames = min(int(seconds * staged.rate), staged.n_frames)
    frames = np.zeros((n_frames, staged.simulation.n_out))
    staged.simulation.process(frames)
    mixed = np.zeros((n_frames, staged.n_channels))
    staged.mixer(highpass=8.0).process(frames, mixed)
    return mixed.T, staged.rate


def spectrum(x: Samples, rate: float) -> tuple[Samples, Samples]:
    """Frequencies [Hz] and magnitudes with a Hann window, zero-padded to twice the resolution."""
    magnitude = np.abs(np.fft.rfft(x * np.hanning(len(x)), 2 * len(x)))
    return np.fft.rfftfreq(2 * len(x), 1 / rate), magnitude


def centroid(x: Samples, rate: float) -> float:
    """Energy-weighted mean frequency between 20 Hz and 16 kHz [Hz]."""
    f, magnitude = spectrum(x, rate)
    audible = (f > 20) & (f < 16_000)
    power = magnitude[audible] ** 2
    return float(np.sum(f[audible] * power) / np.sum(power))


def above(x: Samples, rate: float, lowest: float) -> float:
    """Energy above a frequency over all energy [dB]."""
    f, magnitude = spectrum(x, rate)
    share = np.sum(magnitude[f > lowest] ** 2) / np.sum(magnitude**2)
    return float(10 * np.log10(share + 1e-30))


def click(x: Samples, rate: float) -> float:
    """The peak above 16 kHz from the onset to 2 ms later over the peak of these 2 ms [dB]."""
    begins = int(np.argmax(np.abs(x) > 1e-5 * np.max(np.abs(x))))
    onset = x[max(0, begins - 200) : begins + int(2e-3 * rate)].copy()
    fade = int(1e-3 * rate)
    onset[-fade:] *= np.cos(np.linspace(0.0, np.pi / 2.0, fade)) ** 2
    padded = np.concatenate([onset, np.zeros(2048)])
    spectrum = np.fft.rfft(padded)
    spectrum[np.fft.rfftfreq(len(padded), 1.0 / rate) < 16_000.0] = 0.0
    high = np.fft.irfft(spectrum, len(padded))
    return float(20.0 * np.log10(np.max(np.abs(high)) / np.max(np.abs(onset)) + 1e-12))


def partials(x: Samples, rate: float) -> list[tuple[float, float]]:
    """Frequency [Hz] and level [dB] of each peak within 60 dB of the highest, 20 Hz apart."""
    f, magnitude = spectrum(x, rate)
    levels = 20 * np.log10(magnitude / magnitude.max() + 1e-15)
    width = int(20 / f[1])
    padded = np.pad(levels, (width, width), constant_values=-300.0)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).max(axis=1)
    tops = np.flatnonzero((levels >= around) & (levels > _FLOOR) & (f > 20) & (f < 20_000))
    peaks = []
    for i in tops:
        a, b, c = levels[i - 1 : i + 2]
        curvature = a - 2 * b + c
        peaks.append(
            (float(f[i] + (0.5 * (a - c) / curvature if curvature else 0.0) * f[1]), float(b))
        )
    return peaks


def decay(x: Samples, rate: float, f: float) -> float:
    """T60 [s] of a partial by a line through its level, nan where it does not fall evenly."""
    n = int(0.1 * rate)
    wave = np.exp(-2j * np.pi * f * np.arange(len(x)) / rate) * x
    starts = np.arange(int(_TAIL * rate), len(x) - n, n // 4)
    window = np.hanning(n)
    levels = 20 * np.log10([abs(np.sum(wave[i : i + n] * window)) + 1e-30 for i in starts])
    t = starts / rate
    seen = levels > levels[0] - 50
    if np.sum(seen) < 6:
        return float("nan")
    slope, start = np.polyfit(t[seen], levels[seen], 1)
    even = np.std(levels[seen] - (slope * t[seen] + start)) < 1.5
    return float(-60 / slope) if slope < -0.5 and even else float("nan")


def measured(family: str, name: str, card: dict[str, Any]) -> Card:
    """Play an instrument and measure it."""
    sounds, rate = play(score(family, name, card), SECONDS)
    first = 0 if "strike" in card else int(0.5 * rate)
    strokes = sounds[:, first : first + int(_SPECTRUM_SECONDS * rate)]
    hard = strokes[2]
    peaks = partials(hard, rate)
    if "play" in card:  # breath is no partial
        peaks = [(f, level) for f, level in peaks if stands_out(*spectrum(hard, rate), f)]
    by_level = sorted(peaks, key=lambda one: -one[1])
    soft, middle, strong = (centroid(x, rate) for x in strokes)
    peak = float(np.max(np.abs(sounds[2])))
    figures = Figures(
        family,
        name,
        round(by_level[0][0], 2),
        round(soft, 1),
        round(middle, 1),
        round(strong, 1),
        len(by_level),
        round(max(f for f, _ in by_level), 0),
        round(20 * np.log10(float(np.max(np.abs(sounds[1])))), 1),
        round(above(hard, rate, 16_000), 1),
        round(click(sounds[2], rate), 1),
        round(20 * np.log10(abs(float(np.mean(sounds[2]))) / peak + 1e-12), 0),
    )
    strongest = sorted(by_level[:8])
    modes = tuple(
        Mode(f, level, decay(sounds[2], rate, f) if "strike" in card else float("nan"))
        for f, level in strongest
    )
    return Card(figures, modes, sounds, rate)


def note(f: float) -> str:
    """A frequency as a note and cents."""
    name, cents = nearest_note(f)
    away = round(cents)
    return f"{name} {away:+d} cents".replace("-", "−") if away else name


def text(card: Card, texts: dict[str, Any]) -> str:
    """A card as Markdown."""
    figures = card.figures
    octaves = np.log2(figures.hard / figures.soft)
    rows = [
        f"## {figures.name}",
        "",
        f"![{figures.name}: soft, middle, hard]({figures.name}.svg)",
        "",
        _played(figures.name, texts),
        "",
        "| | soft | middle | hard |",
        "|---|---|---|---|",
        f"| centre of the spectrum [Hz] | {figures.soft:.0f} | {figures.middle:.0f} | "
        f"{figures.hard:.0f} |",
        *_noise(card, texts),
        "",
        f"From soft to hard the centre of the spectrum moves by {octaves:+.1f} octaves. The "
        "hard "
        f"stroke has {figures.partials} partials within 60 dB, up to {figures.highest:,.0f} Hz, a "
        "share "
        "of "
        f"{figures.treble:.0f} dB above 16 kHz ({figures.click:.0f} dB in its first 2 ms), and a "
        f"mean {-figures.mean_level:.0f} dB below its peak. The "
        f"middle one peaks at {figures.loudness:.0f} dB re {_unit(figures)}.".replace("-", "−"),
        "",
        "| strongest modes | note | level [dB] | T60 [s] |",
        "|---|---|---|---|",
    ]
    for mode in card.modes:
        lasts = f"{mode.t60:.2g}" if np.isfinite(mode.t60) else "–"
        level = f"{mode.level:.0f}".replace("-", "−")
        rows.append(f"| {mode.f:.1f} Hz | {note(mode.f)} | {level} | {lasts} |")
    if "known" in texts:
        rows += ["", *_known(card, texts["known"])]
    return "\n".join(rows) + "\n"


def _unit(figures: Figures) -> str:
    """The unit of the instrument's output."""
    path = BESIDE.parents[2] / "instruments" / "library" / f"{figures.family}.yaml"
    read = yaml.safe_load(path.read_text(encoding="utf-8"))
    out = read["instruments"][figures.name]["out"]
    kind = next(iter(out)) if "left" not in out else next(iter(out["left"]))
    return f"1 {OUTPUTS[kind].unit}"


def _played(name: str, texts: dict[str, Any]) -> str:
    if "play" in texts:
        return f"A note of `to: {name}`, at {', '.join(texts['play'].split())}."
    if "strike" in texts:
        to = ", ".join(f"`{name}.{target}`" for target in texts["strike"].split())
        return f"Struck at {to} with {', '.join(texts['impulse'].split())}."
    speeds = ", ".join(texts["speed"].split())
    return f"Rubbed at `{name}.{texts['bow']}` by `{{{texts['law']}}}` at {speeds} mm/s."


def _noise(card: Card, texts: dict[str, Any]) -> list[str]:
    """A row for what a note of a known pitch lasts on: the noise between its partials."""
    if "play" not in texts or "known" not in texts:
        return []
    first = int(0.5 * card.rate)
    steady = card.sounds[:, first : first + int(_SPECTRUM_SECONDS * card.rate)]
    levels = (noise_level(x, card.rate, texts["known"]["of"]) for x in steady)
    cells = " | ".join(f"{level:.0f}".replace("-", "−") for level in levels)
    return [f"| noise between the partials, beside them [dB] | {cells} |"]


def _known(card: Card, known: dict[str, Any]) -> list[str]:
    frequencies = [
        f for f, _ in partials(card.sounds[2][: int(_SPECTRUM_SECONDS * card.rate)], card.rate)
    ]
    cells, away = [], []
    for ratio in known["ratios"]:
        nearest = min(frequencies, key=lambda f: abs(np.log2(f / (known["of"] * ratio))))
        off = 1200 * np.log2(nearest / (known["of"] * ratio))
        cells.append(f"{ratio:g}")
        away.append(f"{off:+.0f}".replace("-", "−") if abs(off) < 150 else "not heard")
    return [
        f"| ratio: {known['source']} | {' | '.join(cells)} |",
        f"|---|{'---|' * len(cells)}",
        f"| here, cents away | {' | '.join(away)} |",
    ]


def counted(page: str, instruments: int) -> str:
    """Return a page with the number of measured instruments where it counts them."""
    return re.sub(r"\b\d+ instruments(?=, (?:a page|measured))", f"{instruments} instruments", page)


def main() -> None:
    """Measure the named families (all by default), and write their pages."""
    name, *families_named = module_arguments("FOLDER", rest_metavar="FAMILY")
    folder = Path(name)
    table = folder / "cards.csv"
    names = [one.name for one in fields(Figures)]
    cards_by_family: dict[str, list[dict[str, Any]]] = {}
    if table.exists():
        with table.open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                cards_by_family.setdefault(row["family"], []).append(row)
    families = described()
    for family in families_named or families:
        texts = families[family]
        cards = [measured(family, name, card) for name, card in texts["cards"].items()]
        cards_by_family[family] = [asdict(card.figures) for card in cards]
        parts = [
            f"# {texts['title']}\n\nMeasured by `make docs` ([how](README.md)). The text of these "
            f"instruments is `instruments/library/{family}.yaml`; `use: "
            f"[instruments/{family}.yaml]` brings them in.\n"
        ]
        for card in cards:
            parts.append(text(card, texts["cards"][card.figures.name]))
            drawn = spectrogram(card.sounds, card.rate, card.figures.name, STROKES)
            (folder / f"{card.figures.name}.svg").write_text(drawn, encoding="utf-8")
        (folder / f"{family}.md").write_text(wrapped("\n".join(parts)), encoding="utf-8")
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, lineterminator="\n")
        writer.writeheader()
        for family in families:
            writer.writerows(cards_by_family.get(family, []))
    instruments = sum(len(cards_by_family.get(family, [])) for family in families)
    pages = [folder / "README.md"]
    if folder.resolve() == ROOT / "docs" / "instruments":
        pages.append(ROOT / "README.md")
    for page in pages:
        if page.exists():
            page.write_text(counted(page.read_text(encoding="utf-8"), instruments), "utf-8")


if __name__ == "__main__":
    main()
