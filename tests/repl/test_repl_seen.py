"""Sessions in which what nobody hears is computed for pages (`--view --see all`)."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from commands import forked
from sessions import Stepped

from ergon import _core
from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240}]
rates: {audio: 8kHz}
instruments:
  sky: {BANK: {count: 8, f: 100Hz..2kHz, t60: 3s, M: 1g}, out: {SOX: sky.all}}
  dark: {STRING: {masses: 12, f: 110Hz, t60: 9s, M: 10g}}
strikes:
  rain: {to: sky.all, at: 1|1, every: 1, times: 40, impulse: 1uNs}
  unheard: {to: dark.3, at: 1|1, impulse: 1mNs}
mix: {channels: 1, route: [{from: sky, to: 1}]}
"""
AUDIBLE_SCORE = SCORE.replace("M: 10g}}", "M: 10g}, out: {SOX: dark.5}}").replace(
    "to: 1}]", "to: 1}, {from: dark, to: 1}]"
)


def kinds(stepped: Stepped) -> dict[str, str]:
    """How each part that can be seen is computed now."""
    simulation = stepped.session.schedule.running.stage.simulation
    return {run.part: run.kind for run in _core.MotionLook(simulation).runs()}


def played(folder: Path, *, is_seen: bool, then: str | None = None) -> tuple[Stepped, dict]:
    """A piece that plays, a line that changes it, and perhaps another version of its file."""
    folder.mkdir()
    stepped = Stepped(SCORE, folder, is_seen=is_seen)
    with closing(stepped):
        stepped.ok("play")
        stepped.run(2.0)
        stepped.ok("gain sky -6dB")
        stepped.run(1.0)
        if then is not None:
            (folder / "score.yaml").write_text(then, encoding="utf-8")
            stepped.ok("reload")
            stepped.run(2.0)
        result = kinds(stepped)
    return stepped, result


def test_seen_unheard_parts_change_no_sample(tmp_path: Path) -> None:
    plain, unheard = played(tmp_path / "plain", is_seen=False)
    seen, all_of_it = played(tmp_path / "seen", is_seen=True)
    assert unheard["dark"] == "none"
    assert all_of_it["dark"] != "none"
    assert np.max(np.abs(plain.sound)) > 0
    assert np.array_equal(plain.sound, seen.sound)


def test_journal_of_seen_parts_audible_later(tmp_path: Path) -> None:
    """A string that was struck while nobody heard it rings on where it was computed."""
    plain, _ = played(tmp_path / "plain", is_seen=False, then=AUDIBLE_SCORE)
    seen, _ = played(tmp_path / "seen", is_seen=True, then=AUDIBLE_SCORE)
    assert not np.array_equal(plain.sound, seen.sound)
    for item in (plain, seen):
        again = item.again()
        assert np.array_equal(again, item.sound[: len(again)])
        assert len(again) > 0.9 * len(item.sound)


def test_journal_with_invalid_see_field_is_refused(tmp_path: Path) -> None:
    stepped, _ = played(tmp_path / "seen", is_seen=True)
    first, *lines = stepped.journal.read_text().splitlines()
    fields = json.loads(first)
    assert fields["see"] == "all"
    stepped.journal.write_text("\n".join([json.dumps({**fields, "see": "some"}), *lines]))
    with pytest.raises(JournalError, match="line 1: `see` is neither absent nor all"):
        read_journal(stepped.journal)


def test_see_option_needs_a_page(work_folder: Path) -> None:
    Path("s.yaml").write_text(SCORE)
    refused = forked(["repl", "s.yaml", "--audio", "null", "--see", "all"], work_folder)
    assert refused.returncode == 2
    assert "--see: this needs a page; add the option view" in refused.stderr
    assert not Path("session.jsonl").exists()
