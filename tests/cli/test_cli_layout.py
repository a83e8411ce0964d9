"""`ergon layout`: tables and holes, layouts by their names, and what is no layout."""

import json
import subprocess
from pathlib import Path

from commands import forked


def ergon(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    return forked(["layout", *words], folder or Path.cwd())


def records(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines()]


def test_a_dome_that_ships_is_checked_by_its_name(tmp_path: Path):
    done = ergon("check", "dome24", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    *ways, whole = records(done.stdout)
    assert [way["by"] for way in ways] == ["nearest", "VBAP", "AllRAD 3", "AllRAD 5"]
    assert abs(ways[0]["off_mean_deg"] - 13.1) < 0.1
    assert (whole["loudspeakers"], whole["symmetric"], whole["holes"]) == (24, True, [])
    assert not whole["open_above"]


def test_holes_are_named(tmp_path: Path):
    (tmp_path / "odd.yaml").write_text("ergon: 1\nspeakers: [{az: 0}, {az: 100}, {az: -120}]\n")
    done = ergon("check", "odd.yaml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "the sides do not mirror each other" in done.stdout
    assert "a hole of 140° between 2 (azimuth 100°" in done.stdout
    assert "a hole overhead" in done.stdout


def test_two_loudspeakers_surround_nobody(tmp_path: Path):
    done = ergon("check", "stereo", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "VBAP" not in done.stdout
    assert "do not surround" in done.stdout


def test_what_is_no_layout_is_told(tmp_path: Path):
    done = ergon("check", "dome25", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean dome24?" in done.stderr
    (tmp_path / "bad.yaml").write_text("ergon: 1\nspeakers: [{az: 10m}, {azz: 1}]\n")
    done = ergon("check", "bad.yaml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "bad.yaml:2:" in done.stderr
    assert "E203" in done.stderr
    assert "'azz'" in done.stderr


def test_layouts_go_to_other_programs_and_come_back(tmp_path: Path):
    for ending, form in ((".json", "iem"), (".yaml", "ear"), (".xml", "spatgris")):
        there = ergon("export", "dome24", "-o", f"d{ending}", folder=tmp_path)
        assert (there.returncode, form in there.stderr) == (0, True), there.stderr
        words = ("import", f"d{ending}", "--radius", "4m", "-o", f"{form}-4.yaml")
        back = ergon(*words, folder=tmp_path)
        assert back.returncode == 0, back.stderr
        again = ergon("check", f"{form}-4.yaml", "--json", folder=tmp_path)
        first = ergon("check", "dome24", "--json", folder=tmp_path)
        for ours, own in zip(records(first.stdout)[:4], records(again.stdout)[:4], strict=True):
            assert abs(ours["off_mean_deg"] - own["off_mean_deg"]) < 1e-3
        assert "r: 4.0m" in (tmp_path / f"{form}-4.yaml").read_text()


def test_noise_comes_from_each_in_turn(tmp_path: Path):
    import numpy as np

    from ergon.exchange import adm
    from ergon.exchange.wave import read_blocks, read_info

    words = ("noise", "dome24", "-o", "n.wav", "--seconds", "0.1", "--level", "-20dB")
    done = ergon(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    info = read_info(tmp_path / "n.wav")
    described = adm.read(info)
    assert described is not None
    assert described.n_channels == 24
    sound = np.concatenate([*read_blocks(tmp_path / "n.wav")]).reshape(24, -1, 24)
    power = np.sqrt((sound**2).sum(1) / 4800.0)
    np.testing.assert_allclose(20.0 * np.log10(np.diag(power)), -20.0, atol=2.0)
    assert not (power - np.diag(np.diag(power))).any(), "one at a time"
    spectrum = np.abs(np.fft.rfft(sound[0, :4800, 0])) ** 2
    low, high = spectrum[20:40].sum(), spectrum[640:1280].sum()  # octaves: 200 Hz, 6.4 kHz
    assert abs(10.0 * np.log10(low / high)) < 3.0, "as much in each octave"


def test_noise_is_played(tmp_path: Path):
    words = ("noise", "stereo", "--audio", "null:fast", "--seconds", "0.05")
    done = ergon(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "1: azimuth 45°" in done.stderr
    assert "2: azimuth -45°" in done.stderr
    assert ergon("noise", "stereo", "--audio", "nonsense", folder=tmp_path).returncode == 3


def test_wrong_files_and_options_are_told(tmp_path: Path):
    (tmp_path / "bad.json").write_text("{}")
    (tmp_path / "a.txt").write_text("")
    for words, said in (
        (("import", "bad.json"), "bad.json: it has no list"),
        (("import", "a.txt"), "give --form"),
        (("import", "no.xml"), "no.xml"),
        (("import", "bad.json", "--radius", "3kg"), "--radius"),
        (("export", "dome24"), "-o FILE"),
        (("export", "dome24", "-o", "-"), "--form"),
        (("noise", "dome24"), "--audio auto"),
        (("noise", "dome24", "-o", "n.wav", "--level", "0dB"), "would clip"),
        (("noise", "dome24", "-o", "n.flac"), "FLAC holds"),
    ):
        before = sorted(tmp_path.iterdir())
        done = ergon(*words, folder=tmp_path)
        assert (done.returncode, done.stdout) == (2, ""), words
        assert said in done.stderr
        assert sorted(tmp_path.iterdir()) == before, "nothing is written"
