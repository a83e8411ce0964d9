"""`python -m benches voices`: what it counts and prints. Nothing here goes by the clock."""

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from benches import voices
from benches.measure import Row
from benches.peers import Missing
from benches.peers.voices import Opcode, orchestra, peak, pm
from benches.voice_cost import Voices, evenness, in_turns, polyphony
from benches.voice_kinds import kinds
from benches.voice_page import Line, method, number, table
from benches.voice_scores import Instrument, instruments, score
from ergon.scores.reading.load import load

_MARIMBA = Line(
    "bars", "marimba", 11, "stepped 11", 130.0, 110.0, {"Csound": ["pluck"], "Faust": []}
)


def test_polyphony_of_eight_voices_in_a_tenth_of_real_time() -> None:
    assert polyphony(8, 2.0, 0.2) == pytest.approx(80.0)


def test_evenness_of_blocks_with_one_stroke() -> None:
    times = np.full(100, 0.001)
    times[40] = 0.011
    assert evenness(times, 0.01) == pytest.approx(0.0011 / 0.002)


def test_evenness_of_fewer_blocks_than_a_tenth() -> None:
    assert evenness(np.array([0.001, 0.005, 0.003]), 0.01) == pytest.approx(1.0)


def test_turns_with_subtracted_start_time() -> None:
    long: Iterator[float] = iter([1.0, 0.7, 0.9])
    start: Iterator[float] = iter([0.3, 0.4, 0.2])
    side = Voices(10, 2.0, lambda: next(long), lambda: next(start))
    assert in_turns(3, {"it": side})["it"] == pytest.approx(10 * 2.0 / (0.7 - 0.2))


def test_turns_alternate_between_sides() -> None:
    order: list[str] = []

    def side(name: str) -> Voices:
        return Voices(1, 1.0, lambda: order.append(name) or 1.0)  # type: ignore[func-returns-value]

    in_turns(2, {"a": side("a"), "b": side("b")})
    assert order == ["a", "b", "a", "b"]


def test_number_rounding_of_large_and_small_counts() -> None:
    assert [number(count) for count in (13_567.0, 134.9, 9.96, 0.84)] == [
        "14,000",
        "130",
        "10",
        "0.8",
    ]


def test_method_text_of_mixed_voices() -> None:
    def row(what: str, part: str, n: int, steps: int = 1) -> SimpleNamespace:
        return SimpleNamespace(what=what, parts=[part], n_mat=n, n_lia=0, oversampling=steps)

    rows = [row("stepped", "v0", 2), row("modes", "v0", 80)]
    rows += [row("stepped", "v1", 82, 2), row("still", "v1.a", 1)]
    rows += [row("stepped", "v2", 2), row("modes", "v2", 80)]
    assert method(rows) == "stepped 2 + modes 80; stepped 82 × 2"


def test_voices_table_with_csound() -> None:
    last = table([_MARIMBA], {"marimba": 130.0, "pluck": 14_000.0}, {}).splitlines()[-1]
    assert last == "| `marimba` | 11 | stepped 11 | **130** | 110 | `pluck` 14,000 | – |"


def test_voices_table_with_missing_csound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    sides, missing = voices.peers([_MARIMBA.references])
    assert sides == {}
    last = table([_MARIMBA], {"marimba": 130.0}, missing).splitlines()[-1]
    assert last.endswith("| `csound` is not here (Debian: csound) | – |")
    (row,) = voices.rows(_MARIMBA, {}, missing)
    assert isinstance(row, Row)
    assert row.ratio is None


def test_pm_with_missing_faust(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(Missing, match=r"faust.*Debian: faust"):
        pm("pm.ks")


def test_peak_of_a_report_with_colours() -> None:
    report = (
        "end of score.\t\t   overall amps:\x1b[m  0.00582\n\t   overall samples out of range: 0"
    )
    assert peak(report) == 0.00582
    assert peak("nothing") == 0.0


def test_orchestra_of_strokes_has_a_note_for_each() -> None:
    text = orchestra(Opcode("a1 pluck 1, 200, 200, 0, 1", True, 3), 1.0)
    assert text.count("\ni1 ") == 6
    assert "i1 0.5 0.5" in text


def test_kinds_of_a_bar_count_its_oscillators() -> None:
    bar = Instrument("bars", "marimba", {})
    assert kinds(bar, 5) == {"Csound": ["mode × 5", "barmodel"], "Faust": ["pm.marimba"]}


def test_kinds_of_plate_empty() -> None:
    assert kinds(Instrument("plates", "bloom", {}), 3) == {"Csound": [], "Faust": []}


@pytest.mark.parametrize("instrument", list(instruments()), ids=lambda each: each.name)
def test_score_of_every_instrument_is_read(instrument: Instrument) -> None:
    loaded = load("voices.yaml", text=score(instrument, 2, 3))
    assert loaded.piece is not None, loaded.diagnostics
    assert not loaded.diagnostics
