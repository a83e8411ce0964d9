"""Captured takes: what is read, and what hostile files are told."""

import io
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

import ergon.scores
from ergon.scores.gesture import npz, takes
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read

LIBRARY = Path(ergon.scores.__file__).parent / "library" / "takes"


def csv(tmp_path, text):
    path = tmp_path / "hand.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("path", sorted(LIBRARY.glob("*.csv")), ids=lambda p: p.stem)
def test_bundled_takes_have_150_samples_at_30_hz(path):
    take = read(path)
    assert len(take.t) == len(take.x) == 150
    assert take.t[0] == take.x[0] == 0
    assert np.allclose(np.diff(take.t), 1 / 30, atol=1e-4)
    assert take.x.std() == pytest.approx(4e-3, rel=0.02)


def test_csv_units_and_channels_by_header(tmp_path):
    path = csv(
        tmp_path, "\ufeff# captured\r\nt [ms];x [mm];f [N]\r\n0;1;2\r\n# pause\r\n10; -3 ;4\r\n"
    )
    with pytest.raises(TakeError, match="write `channel` as one of x, f"):
        read(path)
    take = read(path, "x")
    assert take.t.tolist() == [0.0, 0.01]
    assert take.x.tolist() == [1e-3, -3e-3]
    with pytest.raises(TakeError, match="unit 'N' does not measure position"):
        read(path, "f")


def test_rows_without_times_need_a_rate(tmp_path):
    path = csv(tmp_path, "x [m]\n0\n1e-3\n2e-3\n")
    with pytest.raises(TakeError, match="write the rate"):
        read(path)
    assert read(path, rate=100.0).t.tolist() == [0.0, 0.01, 0.02]
    with pytest.raises(TakeError, match="remove `rate`"):
        read(csv(tmp_path, "t [s],x [m]\n0,0\n1,0\n"), rate=100.0)
    with pytest.raises(TakeError, match="the rate must be above 0"):
        read(path, rate=float("nan"))


SPREADSHEETS = {
    "quoted": '"t [s]","x [mm]"\n"0","1"\n"0.1","2"\n"0.2","4.5"\n',
    "semicolons": "t [s];x [mm]\r\n0;1\r\n0.1;2\r\n0.2;4.5\r\n",
    "decimal commas": "t [s];x [mm]\n0,0;1,0\n0,1;2,0\n0,2;4,5\n",
    "tabs and commas": "t [s]\tx [mm]\n0,0\t1,0\n0,1\t2,0\n0,2\t4,5\n",
    "quoted commas": '"t [s]","x [mm]"\n0,1e0\n0.1,"2"\n0.2,4.5\n',
    "three decimals": "t [s];x [mm]\n0,000;1,000\n0,100;2,000\n0,200;4,500\n",
    "marks of two kinds": "t [s];x [mm]\n0.0;1,0\n0.1;2,0\n0.2;4,5\n",
    "a separator in a name": '"t [s]";"x, of the hand [mm]"\n"0,0";"1,0"\n"0,1";"2"\n"0,2";"4,5"\n',
}


@pytest.mark.parametrize("text", SPREADSHEETS.values(), ids=SPREADSHEETS)
def test_csv_tables_of_spreadsheets(tmp_path, text):
    path = csv(tmp_path, text)
    take = read(path)
    assert take.t.tolist() == [0.0, 0.1, 0.2]
    assert take.x.tolist() == [1e-3, 2e-3, 4.5e-3]
    _, x = summary(path).columns
    assert (x.low_value, x.high_value) == (1.0, 4.5)


def test_csv_unit_option_of_unitless_column(tmp_path):
    path = csv(tmp_path, "t,x,y [cm]\n0,1,1\n0.1,2,3\n")
    take = read(path, "x", unit=1e-3)
    assert (take.t.tolist(), take.x.tolist()) == ([0.0, 0.1], [1e-3, 2e-3])
    with pytest.raises(TakeError, match="states its own unit; remove `unit`"):
        read(path, "y", unit=1e-3)
    assert read(path, "y").x.tolist() == [0.01, 0.03]


def test_csv_columns_named_by_numbers(tmp_path):
    path = csv(tmp_path, "t [s],1,2\n0,1,1\n0.1,2,3\n")
    assert read(path, "2", unit=1e-3).x.tolist() == [1e-3, 3e-3]


def test_csv_summary_without_header_is_refused(tmp_path):
    with pytest.raises(TakeError, match=r"hand\.csv:1: this line is numbers"):
        summary(csv(tmp_path, "1;1;100;2.5\n2;2;100;3.5\n"))


def test_misspelt_channel_has_suggestion(tmp_path):
    path = csv(tmp_path, "t [s],thumb [mm],index [mm]\n0,0,0\n1,0,0\n")
    with pytest.raises(TakeError, match="no channel 'indx'") as caught:
        read(path, "indx")
    assert caught.value.suggestion == "index"


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("t [s],x [mm]\n0,0\n1\n", 3, "has 2 columns"),
        ("t [s],x [mm]\n0,0\n1,2,3\n", 3, "has 2 columns"),
        ("t [s],x [mm]\n# c\n\n0,0\n1,nan\n", 5, "'nan' is not a number"),
        ("t [s],x [mm]\n0,0\n1,inf\n", 3, "'inf' is not a number"),
        ("t [s],x [mm]\n0,0\n1,1e400\n", 3, "not a number"),
        ("t [s],x [mm]\n0,0\n1,1_0\n", 3, "not a number"),
        ("t [s],x [mm]\n0,0\n1,\n", 3, "'' is not a number"),
        ("t [s],x [mm]\n0,0\n1,2\n0.5,3\n", 4, "times must rise"),
        ("t [s],x [mm]\n0,0\n0,2\n", 3, "times must rise"),
        (
            "t,x\n0,0\n",
            1,
            "'x' has no unit; write a header such as t [s],x [mm], or what 1.0 means",
        ),
        ("0,1\n1,2\n", 1, "this line is numbers, but the first line of a table names its columns"),
        ("1;1;100;2.5\n2;2;100;3.5\n", 1, "this line is numbers"),
        ("0.0;\u22121.5\n0.1;2\n", 1, "this line is numbers"),
        ("0.;1'000.5\n0.1;2\n", 1, "this line is numbers"),
        ("0.0,1.0,ok\n0.1,2.0,ok\n", 1, "this line is a row of values"),
        ("0.0,NA\n0.1,2.0\n", 1, "this line is a row of values"),
        ("00:00:00.0,0\n00:00:00.1,1.5\n", 1, "this line is a row of values"),
        ("t [s]\tx [mm]\n0\t998.5\n0.1\t1,000\n", 3, "comma in '1,000' may divide thousands"),
        ("t [s];x [mm]\n0;1,000\n0.1;998.5\n", 2, "comma in '1,000' may divide thousands"),
        ("t [s];x [mm]\n0;998,5\n0,1;1.000\n", 3, "point in '1.000' may divide thousands"),
        ("t [s];x [mm]\n0;1.000\n1;998,5\n", 2, "point in '1.000' may divide thousands"),
        ("t [s];x [mm]\n0;999\n1;1,000\n", 3, "comma in '1,000' may divide thousands"),
        ("t [s];x [mm]\n0;1.000\n1;1,000\n", 3, "comma in '1,000' may divide thousands"),
        ('t [s],"x [mm]\n0,0\n', 1, "a quotation in this line is not closed"),
        ("x [mm],x [mm]\n0,0\n", 1, "two columns are called 'x'"),
        ("", 1, "is not the name of a column"),
        ("t [s],x [mm]\n0," + "0" * 70_000, 2, "this line has more than"),
        ("t [s],x [mm]\n0,0\n", None, "two samples"),
        ("t [s],x [mm]\n", None, "two samples"),
        ("t [s]\n0\n1\n", None, "no channel"),
        ("t [kg],x [mm]\n0,0\n1,1\n", None, "unit 'kg' does not measure time"),
        ("t [s],x []\n0,0\n1,1\n", None, "unit '' does not measure position"),
        ("t [s],x [m]\n0,0\n1,1e9\n", None, "more than 1,000 m"),
        (b"t [s],x [mm]\n0,\xff\n", 2, "'ÿ' is not a number"),
        (b"\x00" * 100_000, None, "this is not text"),
    ],
)
def test_csv_bad_row_message_names_line(tmp_path, text, line, words):
    with pytest.raises(TakeError) as caught:
        read(csv(tmp_path, text))
    assert caught.value.line == line
    assert words in caught.value.message
    assert caught.value.message.startswith("hand.csv" if line is None else f"hand.csv:{line}: ")


def test_take_sample_count_limits(tmp_path, monkeypatch):
    path = csv(tmp_path, "t [s],x [mm]\n0,0\n1,1\n2,0\n")
    for module in (takes, npz):
        monkeypatch.setattr(module, "MAX_SAMPLES", 2)
    with pytest.raises(TakeError, match=r"hand.csv:4: the file has more than 2 samples"):
        read(path)
    soundfile.write(tmp_path / "x.wav", np.zeros(3), 100)
    with pytest.raises(TakeError, match="more than 2 samples"):
        read(tmp_path / "x.wav")
    np.savez(tmp_path / "x.npz", t=np.arange(3.0), x=np.zeros(3))
    with pytest.raises(TakeError, match="more than 2 samples"):
        read(tmp_path / "x.npz")
    with path.open("r+b") as file:
        file.truncate((1 << 30) + 1)  # a hole, no bytes on the disk
    with pytest.raises(TakeError, match="more than 1 GB"):
        read(path)


def test_missing_and_unknown_take_files(tmp_path):
    for name, words in [("no.csv", "the file does not exist"), ("x.gms", "cannot be read yet")]:
        with pytest.raises(TakeError, match=words):
            read(tmp_path / name)
    (tmp_path / "dir.csv").mkdir()
    with pytest.raises(TakeError, match="the file does not exist"):
        read(tmp_path / "dir.csv")


def test_wav_take_scale_channel_and_rate(tmp_path):
    path = tmp_path / "hand.wav"
    x = np.array([[0.0, 0.5], [0.25, -0.5], [-1.0, 0.0]])
    soundfile.write(path, x, 3000, subtype="DOUBLE")
    take = read(path, "2", unit=0.01)
    assert take.x.tolist() == [0.005, -0.005, 0.0]
    assert take.t.tolist() == [0.0, 1 / 3000, 2 / 3000]
    assert read(path, "1").x.tolist() == x[:, 0].tolist()
    with pytest.raises(TakeError, match="no channel '3'"):
        read(path, "3")
    soundfile.write(path, x[:, 0], 3000, subtype="DOUBLE")
    assert read(path).x.tolist() == x[:, 0].tolist()


def wav_header(n_data):
    """The header of a mono WAV of doubles at 3 kHz that says it holds n_data bytes."""
    fmt = struct.pack("<HHIIHH", 3, 1, 3000, 24000, 8, 64)
    return (
        b"RIFF"
        + struct.pack("<I", 0xFFFFFFFF)
        + b"WAVEfmt "
        + struct.pack("<I", 16)
        + fmt
        + (b"data" + struct.pack("<I", n_data))
    )


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a WAVE file"),
        (b"RIFF....WAVE", "holds no samples"),
        (wav_header(0xFFFFFFF8) + b"\0" * 8, "shorter than its header says"),
        (wav_header(24) + struct.pack("<3d", 0, float("nan"), 0), "sample 2 of x is not finite"),
        (wav_header(24) + struct.pack("<3d", 0, 1e9, 0), "more than 1,000 m"),
    ],
)
def test_hostile_wav_files(tmp_path, data, words):
    path = tmp_path / "hand.wav"
    path.write_bytes(data)
    with pytest.raises(TakeError, match=words):
        read(path)


def test_npz_take_units_and_rate(tmp_path):
    path = tmp_path / "hand.npz"
    np.savez_compressed(path, **{"t": np.arange(3) / 10, "x [mm]": [1, 2, 3], "y": [0.5, 0, 0]})
    assert read(path, "x").x.tolist() == [0.001, 0.002, 0.003]
    assert read(path, "y").t.tolist() == [0.0, 0.1, 0.2]
    np.savez(path, x=np.zeros(3, dtype=">f4"))
    assert read(path, rate=10.0).x.dtype == np.float64


def npy(header, data=b""):
    """An npz whose array x.npy has just this header."""
    text = header.encode() + b"\n"
    body = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", body)
    return out.getvalue()


def described(descr, shape):
    return npy(f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}", b"\0" * 64)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK", "not an npz file"),
        (described("<f8", "(100000000000,)"), "more than 20,000,000"),
        (described("<f8", "(-1,)"), "more than 20,000,000"),
        (described("<f8", "(1000,)"), "cut short"),
        (described("<f8", "(2, 2)"), "not a row of numbers"),
        (described("|O", "(8,)"), "not a row of numbers"),
        (described("<c16", "(4,)"), "not a row of numbers"),
        (npy("{'descr': __import__('os')}"), "header of 'x'"),
        (npy("(" * 5000), "header of 'x'"),
        (npy("9" * 60_000), "header of 'x'"),
    ],
)
def test_hostile_npz_files(tmp_path, data, words):
    path = tmp_path / "hand.npz"
    path.write_bytes(data)
    with pytest.raises(TakeError, match=words):
        read(path, rate=100.0)


def test_npz_with_pickled_objects_is_refused(tmp_path):
    """Opened, it would make a folder."""

    class Opened:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "opened"),)

    path = tmp_path / "hand.npz"
    np.savez(path, x=np.array([Opened()], dtype=object))
    with pytest.raises(TakeError, match="not a row of numbers"):
        read(path, rate=100.0)
    assert not (tmp_path / "opened").exists()


def test_npz_arrays_must_belong_together(tmp_path):
    path = tmp_path / "hand.npz"
    np.savez(path, t=np.arange(3.0), x=np.zeros(4))
    with pytest.raises(TakeError, match="3 times and 4 positions"):
        read(path)
    np.savez(path, t=[0.0, 2.0, 1.0], x=np.zeros(3))
    with pytest.raises(TakeError, match="sample 3 does not"):
        read(path)


def test_npz_with_flipped_bytes_is_read_or_refused(tmp_path):
    path = tmp_path / "hand.npz"
    np.savez_compressed(path, t=np.arange(20.0), x=np.linspace(0, 1e-3, 20))
    complete = path.read_bytes()
    for i in range(0, len(complete), 3):
        path.write_bytes(complete[:i] + bytes([complete[i] ^ 0xFF]) + complete[i + 1 :])
        try:
            take = read(path)
        except TakeError:
            continue
        assert len(take.x) == 20


@given(st.binary(max_size=200))
def test_csv_of_random_bytes_is_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(b"t [s],x [mm]\n0,0\n" + data)
    try:
        take = read(path)
    except TakeError:
        return
    assert np.isfinite(take.x).all()
    assert (np.diff(take.t) > 0).all()


@pytest.mark.parametrize(
    ("form", "subtype"),
    [
        ("WAV", "MS_ADPCM"),
        ("WAV", "ULAW"),
        ("FLAC", "PCM_16"),
        ("AIFF", "PCM_16"),
        ("OGG", "VORBIS"),
    ],
)
def test_wav_name_with_other_format_is_refused(tmp_path, form, subtype):
    """No decoder of another form is behind the name of a WAV file."""
    path = tmp_path / "hand.wav"
    soundfile.write(path, np.zeros(2000), 8000, format=form, subtype=subtype)
    with pytest.raises(TakeError, match=r"not a WAVE file|samples coded as|in the form"):
        read(path)


@pytest.mark.parametrize("form", ["WAV", "WAVEX", "RF64"])
@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"])
@pytest.mark.parametrize("endian", ["LITTLE", "BIG"])
def test_wav_take_of_every_uncompressed_format(tmp_path, form, subtype, endian):
    path = tmp_path / "hand.wav"
    if endian == "BIG" and form != "WAV":
        endian = "FILE"
    soundfile.write(path, [0, 0.5, -0.5], 100, format=form, subtype=subtype, endian=endian)
    assert read(path).x == pytest.approx([0, 0.5, -0.5], abs=1e-4)
