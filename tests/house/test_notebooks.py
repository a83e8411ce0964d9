"""Notebooks of docs/ are executed, and what their cells show is a picture or a table that opens."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from notebooks import code_cells, run_notebook
from sweep import few

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
LONG = {"metrology", "stability"}  # what they call is tested by itself


def test_notebooks_listed_on_page():
    page = (FOLDER.parent / "notebook.md").read_text(encoding="utf-8")
    assert [name for name in NAMES if f"notebooks/{name}.ipynb" not in page] == []
    assert len(NAMES) == 6


@pytest.mark.parametrize("name", few(NAMES, [name for name in NAMES if name not in LONG]))
def test_notebook_cells_run_with_pictures(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    path = FOLDER / f"{name}.ipynb"
    shown = run_notebook(path, tmp_path)
    assert len(shown) == len(code_cells(path))
    drawn = [text for text in shown if text and "<svg" in text]
    assert drawn, "no cell shows a picture"
    for text in drawn:
        ElementTree.fromstring(text[text.index("<svg") :])
