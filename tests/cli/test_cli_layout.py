"""`ergon layout`: tables and holes, layouts by their names, and what is no layout."""

import json
import subprocess
from pathlib import Path

import numpy as np
import soundfile
from commands import forked


def ergon(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    return forked(["layout", *words], folder or Path.cwd())


def records(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines()]


def test_layout_check_of_bundled_dome(tmp_path: Path):
    done = ergon("check", "dome24", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    *ways, complete = records(done.stdout)
    assert [way["by"] for way in ways] == ["nearest", "VBAP", "AllRAD 3", "AllRAD 5"]
    assert abs(ways[0]["off_mean_deg"] - 13.1) < 0.1
    assert (complete["loudspeakers"], complete["symmetric"], complete["holes"]) == (24, True, [])
    assert not complete["open_above"]


def test_layout_check_reports_holes(tmp_path: Path):
    (tmp_path / "odd.yaml").write_text("ergon: 1\nspeakers: [{az: 0}, {az: 100}, {az: -120}]\n")
    done = ergon("check", "odd.yaml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "the sides do not mirror each other" in done.stdout
    assert "a hole of 140° between 2 (azimuth 100°" in done.stdout
    assert "a hole overhead" in done.stdout


def test_layout_check_of_stereo_pair(tmp_path: Path):
    done = ergon("check", "stereo", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "VBAP" not in done.stdout
    assert "do not surround" in done.stdout


def test_layout_check_refuses_wrong_layouts(tmp_path: Path):
    done = ergon("check", "dome25", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean dome24?" in done.stderr
    (tmp_path / "bad.yaml").write_text("ergon: 1\nspeakers: [{az: 10m}, {azz: 1}]\n")
    done = ergon("check", "bad.yaml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "bad.yaml:2:" in done.stderr
    assert "E203" in done.stderr
    assert "'azz'" in done.stderr


def test_layout_export_and_import_round_trip(tmp_path: Path):
    for ending, form in ((".json", "iem"), (".yaml", "ear"), (".xml", "spatgris")):
        there = ergon("export", "dome24", "-o", f"d{ending}", folder=tmp_path)
        assert (there.returncode, form in there.stderr) == (0, True), there.stderr
        words = ("import", f"d{ending}", "--radius", "4m", "-o", f"{form}-4.yaml")
        back = ergon(*words, folder=tmp_path)
        assert back.returncode == 0, back.stderr
        again = ergon("check", f"{form}-4.yaml", "--json", folder=tmp_path)
        first = ergon("check", "dome24", "--json", folder=tmp_path)
        for ours, item in zip(records(first.stdout)[:4], records(again.stdout)[:4], strict=True):
            assert abs(ours["off_mean_deg"] - item["off_mean_deg"]) < 1e-3
        assert "r: 4.0m" in (tmp_path / f"{form}-4.yaml").read_text()


def test_layout_noise_from_each_speaker_in_turn(tmp_path: Path):
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


def test_layout_noise_played_on_null_audio(tmp_path: Path):
    words = ("noise", "stereo", "--audio", "null:fast", "--seconds", "0.05")
    done = ergon(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "1: azimuth 45°" in done.stderr
    assert "2: azimuth -45°" in done.stderr
    assert ergon("noise", "stereo", "--audio", "nonsense", folder=tmp_path).returncode == 3


def test_layout_commands_refuse_wrong_files_and_options(tmp_path: Path):
    (tmp_path / "bad.json").write_text("{}")
    (tmp_path / "a.txt").write_text("")
    for words, message in (
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
        assert message in done.stderr
        assert sorted(tmp_path.iterdir()) == before, "nothing is written"


GRIS = """\
<SPEAKER_SETUP VERSION="3.1.0" SPAT_MODE="Dome">
<SPEAKER_1 STATE="normal" DIRECT_OUT_ONLY="0"><POSITION X="-1" Y="1" Z="0"/></SPEAKER_1>
<SPEAKER_2 STATE="normal" DIRECT_OUT_ONLY="0"><POSITION X="1" Y="1" Z="0"/></SPEAKER_2>
<SPEAKER_3 STATE="normal" DIRECT_OUT_ONLY="1"><POSITION X="0" Y="1" Z="0"/></SPEAKER_3>
<SPEAKER_4 STATE="normal" DIRECT_OUT_ONLY="0"><POSITION X="1" Y="-1" Z="0"/></SPEAKER_4>
<SPEAKER_6 STATE="normal" DIRECT_OUT_ONLY="0"><POSITION X="-1" Y="-1" Z="0"/></SPEAKER_6>
</SPEAKER_SETUP>
"""


def test_layout_outputs_with_gaps_in_all_commands(tmp_path: Path):
    (tmp_path / "room.xml").write_text(GRIS)
    done = ergon("import", "room.xml", "--radius", "2m", "-o", "room.yaml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "output 3 is a direct out" in done.stderr
    assert "outputs: [1, 2, 4, 6]" in (tmp_path / "room.yaml").read_text()
    for form, read in (("json", '"Channel": 6'), ("yaml", "channel: 5"), ("xml", "SPEAKER_6")):
        done = ergon("export", "room.yaml", "-o", f"back.{form}", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert read in (tmp_path / f"back.{form}").read_text()
    done = ergon("noise", "room.yaml", "-o", "n.wav", "--seconds", "0.1", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    sound, _ = soundfile.read(tmp_path / "n.wav")
    assert [bool(peak > 0.1) for peak in abs(sound).max(axis=0)] == [1, 1, 0, 1, 0, 1]
    fold = ["fold", "n.wav", "--layout", "room.yaml", "--to"]
    done = forked([*fold, "room.yaml", "-o", "same.wav", "--bits", "float"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "channels 3 and 5 are not among the loudspeakers of the layout" in done.stderr
    same, _ = soundfile.read(tmp_path / "same.wav")
    assert np.array_equal(same, sound)
    done = forked([*fold, "stereo", "-o", "two.wav", "--bits", "float"], tmp_path)
    assert done.returncode == 0, done.stderr
    two, rate = soundfile.read(tmp_path / "two.wav")
    left, right = np.abs(two[: int(0.1 * rate)]).max(axis=0)
    assert left > 2.0 * right


def test_render_to_layout_outputs_between_speakers(tmp_path: Path):
    (tmp_path / "room.yaml").write_text(
        "ergon: 1\nspeakers: [{az: 45}, {az: -45}, {az: 180}]\noutputs: [1, 2, 5]\n"
    )
    (tmp_path / "s.yaml").write_text("""\
ergon: 1
instruments:
  sub: {CEL: {M: 1g, f: A2, t60: 0.2s}, out: {SOX: sub}}
strikes: {s: {to: sub, at: 0s, impulse: 1mNs}}
mix: {layout: room.yaml, route: [{from: sub, to: [4, 5]}]}
render: {tail: 1s}
""")
    done = forked(["render", "s.yaml", "-o", "s.wav"], tmp_path)
    assert done.returncode == 0, done.stderr
    sound, _ = soundfile.read(tmp_path / "s.wav")
    assert [bool(peak > 0.0) for peak in abs(sound).max(axis=0)] == [0, 0, 0, 1, 1]


def test_layout_refuses_wrong_outputs(tmp_path: Path):
    for outputs, message in (("[1, 2]", "2 outputs for 3 loud"), ("[1, 2, 2]", "at the output 2")):
        (tmp_path / "room.yaml").write_text(
            f"ergon: 1\nspeakers: [{{az: 45}}, {{az: -45}}, {{az: 180}}]\noutputs: {outputs}\n"
        )
        done = ergon("check", "room.yaml", folder=tmp_path)
        assert done.returncode == 1
        assert message in done.stderr
