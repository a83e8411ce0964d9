"""A session without a score: a piece is typed from nothing."""

from pathlib import Path

from commands import forked

LINES = "kick = skins/kick\nd1 strikes kick.hammer every 1 impulse 200mNs\n"
BEGIN = ["repl", "--audio", "null", "--plain"]


def test_empty_piece_saved(work_folder: Path):
    done = forked(BEGIN, work_folder, lines=f"{LINES}save\nquit\n")
    assert "ok wrote piece.yaml" in done.stdout, done.stdout
    text = Path("piece.yaml").read_text()
    assert text.startswith("ergon: 1\n")
    assert "kick: {from: skins/kick}" in text
    assert "route: [{from: kick, to: [1, 2], level: -20LUFS}]" in text
    assert forked(["check", "piece.yaml"], work_folder).returncode == 0


def test_empty_piece_beside_existing_file(work_folder: Path):
    Path("piece.yaml").write_text("mine")
    done = forked(BEGIN, work_folder, lines=f"{LINES}save\nquit\n")
    assert "ok wrote piece-2.yaml" in done.stdout, done.stdout
    assert Path("piece.yaml").read_text() == "mine"


def test_empty_piece_resumed_unsaved(work_folder: Path):
    forked(BEGIN, work_folder, lines=f"{LINES}quit\n")
    lines = "show kick\nsave tune\nquit\n"
    done = forked([*BEGIN, "--resume", "session.jsonl"], work_folder, lines=lines)
    assert "kick: {from: skins/kick}" in done.stdout
    assert "ok wrote tune.yaml" in done.stdout, done.stdout
