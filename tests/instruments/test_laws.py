from pathlib import Path

import pytest
import yaml

from ergon import _core, instruments
from ergon.instruments.laws import is_name
from ergon.scores.reading.load import load

NETWORK = """\
ergon: 1
%s
instruments:
  i:
    modules:
      a: {SOL: {}}
      m: {MAS: {M: 1g}}
      n: {LNL: {between: [a, m], %s}}
    out: {SOF: n}
"""
SHIPPED = "cubic clipped-cubic power rope detent pluck bow bow-hyperbolic coulomb"


def loaded_fields(fields, laws=""):
    loaded = load("s.yaml", text=NETWORK % (laws, fields))
    assert not loaded.diagnostics
    return loaded.piece.instruments["i"].modules[2].fields


@pytest.mark.parametrize("name", SHIPPED.split())
def test_bundled_laws_have_text_and_constants(name):
    fields = loaded_fields(f"law: {name}")
    assert fields["law"] or fields["damping"]
    assert not is_name(fields["law"])
    assert fields["constants"]


def test_law_constants_of_module_override_defaults():
    fields = loaded_fields("law: cubic, q: 5N/mm3")
    assert fields["constants"] == {"k": 1000.0, "q": 5e9, "z": 0.0}


def test_laws_of_the_score():
    laws = "laws: {mine: {law: k*d**5, damping: z*v, k: 3, z: 0.1Ns/m}}"
    fields = loaded_fields("law: mine, z: 2", laws)
    assert (fields["law"], fields["damping"]) == ("k*d**5", "z*v")
    assert fields["constants"] == {"k": 3.0, "z": 2.0}


def test_law_of_single_letter_is_expression():
    assert loaded_fields("law: d")["law"] == "d"
    assert loaded_fields("law: k, k: 2N")["law"] == "k"


def test_law_text_never_executed(tmp_path):
    path = tmp_path / "x"
    hostile = f"__import__('os').system('touch {path}')"
    fields = f'law: "{hostile}"'
    load("s.yaml", text=NETWORK % ("", fields))
    assert not path.exists()


def test_long_laws_are_refused():
    text = NETWORK % ("", f"law: {'d+' * 2000}d")
    assert [d.code for d in load("s.yaml", text=text).diagnostics] == ["E207"]


@pytest.mark.skipif(not hasattr(_core, "Law"), reason="this core has no laws yet")
def test_mistakes_in_laws_have_places():
    text = NETWORK % ("", 'law: "k*d + q*dd", k: 1N/m, q: 1')
    report = load("s.yaml", text=text).diagnostics[0]
    assert report.code == "E207"
    assert text.split("\n")[report.place.line - 1][report.place.column - 1 :].startswith("dd")


def test_law_library_file_checks_without_diagnostics():
    path = Path(instruments.__file__).parent / "library/laws.yaml"
    assert load(path).diagnostics == []
    assert set(yaml.safe_load(path.read_text(encoding="utf-8"))["laws"]) == set(SHIPPED.split())


def test_law_misspelt_field_suggestion():
    text = NETWORK % ("", 'law: k*d, k: 1, dampng: "z*v"')
    report = load("s.yaml", text=text).diagnostics[0]
    assert (report.code, report.suggestion) == ("E101", "damping")
