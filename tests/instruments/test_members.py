"""Members of generators: `3..8`, `3..last`, `centre`, in names and in what starts elsewhere."""

import textwrap

import numpy as np
import pytest

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

STRING = """\
ergon: 1
instruments:
  s: {STRING: {masses: 20, f: A2, M: 8g, X0: {at: %s, x: 1mm}}, out: {SOX: s.%s}}
"""


@pytest.mark.parametrize(
    ("start", "listened", "sum_mm"),
    [("3..8", "all", 6), ("3..last", "all", 17), ("last", "last", 1), ("centre", "0", 0)],
)
def test_members_start_values_and_outputs(start, listened, sum_mm):
    simulation = stage(load("x.yaml", text=STRING % (start, listened)).piece).simulation
    out = np.zeros((1, 1))
    simulation.process(out)
    assert out[0, 0] == pytest.approx(sum_mm * 1e-3)


@pytest.mark.parametrize("at", ["foo", "20", "3..20", "8..3", "-1", "s.3", "1.."])
def test_members_outside_range_refused(at):
    found = load("x.yaml", text=STRING % (at, "0")).diagnostics
    assert [(d.code, d.place.line, d.place.column) for d in found] == [("E304", 3, 51)]


def test_unknown_member_help_lists_modules():
    (found,) = load("x.yaml", text=(STRING % ("0", "0")).replace("s.0", "q.0")).diagnostics
    assert found.help == "known here: s"


def test_string_with_start_and_hardening_behind_lever():
    """Seen through reach 2, a string is the same string with lengths doubled, forces halved."""
    plain, levered = (_last_of_key(reach) for reach in (1, 2))
    assert levered == pytest.approx(2 * plain, abs=1e-12)


def _last_of_key(reach: float) -> np.ndarray:
    text = f"""\
    ergon: 1
    keys:
      k:
        struck: m
        reach: {reach}
        modules:
          m: {{CEL: {{M: 400g, K: 60N/m}}}}
          s: {{STRING: {{masses: 5, f: 80Hz, M: 8g, hardening: 4e8N/m3, X0: {{at: 1..2, x: 1mm}}}}}}
    instruments: {{e: {{modules: {{g: {{SOL: {{}}}}}}, out: {{SOX: k.s.last}}}}}}
    """
    simulation = stage(load("x.yaml", text=textwrap.dedent(text)).piece).simulation
    out = np.zeros((2000, 1))
    simulation.process(out)
    assert np.abs(out).max() > 1e-4
    return out[:, 0]
