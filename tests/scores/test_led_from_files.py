"""What automation changes belongs to the piece, wherever its instrument is written."""

from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
use: [instruments/bell.yaml]
automation: [{set: bell.hum.f, to: A3 C4, every: 1, at: 1|1}]
"""


def test_instrument_named_only_by_automation_is_loaded():
    loaded = load("s.yaml", text=SCORE)
    assert loaded.piece is not None, loaded.diagnostics
    assert [one.name for one in loaded.piece.automation] == ["bell.hum.f"]
    assert "bell" in loaded.piece.instruments
