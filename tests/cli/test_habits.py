"""What a newcomer types by habit is answered with what to do."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
import pytest
from one_bell import SCORE

from ergon.cli import app, examples
from ergon.cli.lazy import LazyGroup

# (line, exit code, words of the answer)
HABITS = [
    ("-h", 0, "Usage: ergon"),
    ("help", 0, "Usage: ergon"),
    ("help render", 0, "Usage: ergon render"),
    ("render -h", 0, "Usage: ergon render"),
    ("doctor -h --verbose", 0, "Usage: ergon doctor"),
    ("render help", 2, "ergon render --help"),
    ("version", 2, "Use: ergon --version"),
    ("-V", 2, "Use: ergon --version"),
    ("-version", 2, "Use: ergon --version"),
    ("-help", 2, "ergon help"),
    ("?", 2, "Use: ergon help"),
    ("-v", 2, "ergon check piece.yaml -v"),
    ("--verbose", 2, "--verbose follows a command"),
    ("--list", 2, "`ergon help` lists all commands"),
    ("quit", 2, "`ergon help` lists all commands"),
    ("piece.yaml", 2, "ergon render piece.yaml"),
    ("piece.yaml check", 2, "ergon check piece.yaml"),
    ("-o x.wav render piece.yaml", 2, "ergon render piece.yaml -o x.wav"),
    ("--quiet render piece.yaml", 2, "ergon render piece.yaml --quiet"),
    ("--json check piece.yaml", 2, "ergon check piece.yaml --json"),
    ("rendr piece.yaml", 2, "Did you mean 'render'?"),
    ("run piece.yaml", 2, "Use: ergon render piece.yaml"),
    ("build piece.yaml", 2, "Use: ergon render piece.yaml"),
    ("lint piece.yaml", 2, "Use: ergon check piece.yaml"),
    ("init bells", 2, "Use: ergon new bells"),
    ("ls", 2, "Use: ergon demo --list"),
    ("examples", 2, "Use: ergon demo --list"),
    ("live", 2, "Use: ergon repl"),
    ("record", 2, "Use: ergon take record"),
    ("update", 2, "Use: ergon help install"),
    ("render", 2, "for example: ergon render piece.yaml -o piece.wav"),
    ("render -o piece.wav", 2, "for example: ergon render piece.yaml"),
    ("new", 2, "for example: ergon new bells"),
    ("fold x.wav", 2, "for example: ergon fold dome.wav --to binaural"),
    ("sweep piece.yaml", 2, "for example: ergon sweep piece.yaml --vary seed=1..4"),
    ("take lst", 2, "Did you mean 'list'?"),
    ("take xyzzy", 2, "`ergon take -h`"),
    ("demo duett", 2, "did you mean 'duet'?"),
    ("demo list", 2, "ergon demo --list"),
    ("plan --hlep", 2, "--help"),
    ("render piece.yaml --ouput x.wav", 2, "--output"),
    ("render piece.yaml -output x.wav", 2, "two dashes: --output"),
    ("render piece.yaml x.wav", 1, "-o x.wav"),
    ("render --rate 48 kHz piece.yaml", 2, "a unit may follow: Hz, kHz"),
    ("render --rate 48kV piece.yaml", 2, "a rate has Hz, kHz"),
    ("check .", 1, "did you mean piece.yaml?"),
    ("check piece.yml", 1, "did you mean piece.yaml?"),
    ("check nothing.yaml", 1, "ergon demo --list"),
    ("--help render", 0, "Usage: ergon render"),
    ("-h take list", 0, "Usage: ergon take list"),
    ("help rendr", 2, "did you mean 'render'?"),
    ("play ./sound.wav", 2, "`ergon plot ./sound.wav` draws it"),
    ("render sound.flac", 2, "a sound, not a score: `ergon info sound.flac`"),
    ("check tune.mid", 2, "a MIDI file, not a score: `ergon info tune.mid`"),
    ("repl hand.take", 2, "a take, not a score"),
    ("play a.motion", 2, "`ergon view a.motion` shows it"),
    ("render piece.yaml -o", 2, "requires an argument; write -o FILE"),
    ("play piece.yaml --audio", 2, "requires an argument; write --audio "),
    ("render piece.yaml -o piece.mp3", 2, "write piece.wav"),
    ("render piece.yaml --format flac", 2, "-o piece.flac"),
    ("render piece.yaml --sample-rate 48000", 2, "--rate 48kHz"),
    ("render piece.yaml --tempo 90", 2, "`tempo 90` at the prompt of `ergon repl`"),
    ("render piece.yaml --duration 5s", 2, "--until TIME ends it there"),
    ("render piece.yaml --volume 3", 2, "No such option '--volume'"),
    ("play piece.yaml --volume 3", 2, "--gain -6dB"),
    ("play piece.yaml --device hw:0", 2, "--audio names the sound card"),
    ("plan piece.yaml --device hw:0", 2, "No such option '--device'"),
    ("render piece.yaml --bits 32", 2, "'16', '24', 'float'"),
    ("play piece", 2, "did you mean"),
    ("new piece.yaml", 2, "write ergon new piece"),
    ("new mine --template piano", 2, "'bell', 'duet'"),
    ("demo --lsit", 2, "--list"),
    ("explain E999", 2, "`ergon help errors` lists all codes"),
    ("fmt notes.txt", 2, "this is not a score"),
    ("share sound.wav -o x.html", 2, "neither a score (.yaml) nor a .motion file"),
    ("export piece.yaml -o out --to midi", 2, "'daw', 'modal'"),
    ("modes piece.yaml Bell", 2, "did you mean 'bell'?"),
    ("completion powershell", 2, "'bash', 'zsh', 'fish'"),
    ("take record", 2, "for example: ergon take record"),
    ("plan piece.yaml --method best", 2, "ca, modal"),
    ("render piece.yaml --until 5sec", 2, "(use beats without a unit, bar, ms, s)"),
    ("explain render", 2, "ergon help errors"),
    ("explain", 2, "for example: ergon explain E204"),
    ("explain 'unknown name'", 2, "did you mean E101: an unknown name?"),
    ("midi", 2, "`ergon help midi` opens a page about it"),
    ("notebook", 2, "`ergon help notebook` opens a page about it"),
    ("stop", 2, "`ergon help stop` opens a page about it"),
    ("tempo 90", 2, "Use: ergon help tempo"),
    ("edit piece.yaml", 2, "Use: ergon help editors"),
    ("gui piece.yaml", 2, "Use: ergon view piece.yaml"),
    ("uninstall", 2, "pip uninstall ergon-live"),
    ("help how do I tune", 0, "The page howto/tune."),
    ("help view", 0, "ergon help view.md"),
    ("info notes.txt", 2, "notes.txt is nothing that ergon reads"),
    ("info duett", 2, "did you mean duet, which ships?"),
    ("view piece.yaml --port 8080", 2, "--at 127.0.0.1:8080"),
    ("render piece.yaml --stereo", 2, "`mix: {channels: 2}`"),
    ("plot piece.yaml --png x.png", 2, "--svg FILE"),
    ("render http://example.org/a.yaml", 1, "download it first"),
    ("render '*.yaml'", 1, "no file has such a name"),
    ("--verison", 2, "Did you mean '--version'?"),
    ("render piece.yaml -o out/", 2, "write out.wav"),
    ("listen piece.yaml", 2, "Use: ergon play piece.yaml"),
    ("play song.mp3", 2, "`ffmpeg -i song.mp3 sound.wav` makes it WAV"),
    ("new my piece", 2, "write ergon new my-piece"),
    ("convert song.mp3", 2, "Use: ffmpeg -i song.mp3 song.wav"),
    ("convert piece.yaml", 2, "Use: ergon help export"),
    ("song.MP3", 2, "Use: ffmpeg -i song.MP3 song.wav"),
    ("sound.wav", 2, "Use: ergon info sound.wav"),
    ("a.motion", 2, "Use: ergon view a.motion"),
    ("devices list", 2, "Use: ergon devices"),
    ("serve piece.yaml", 2, "Use: ergon view piece.yaml"),
    ("export piece.yaml --midi", 2, "writes tempo.mid, with the notes"),
    ("install numba", 2, "Use: ergon help install"),
    ("explain 204", 2, "did you mean E204"),
    ("share", 2, "for example: ergon share piece.yaml -o piece.html"),
]


@pytest.mark.parametrize(("line", "code", "answer"), HABITS, ids=[line for line, _, _ in HABITS])
def test_mistyped_command_lines_answered_with_advice(
    line: str,
    code: int,
    answer: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Path("piece.yaml").write_text(SCORE)
    Path("notes.txt").write_text("milk\n\n\n")
    for name in ("sound.wav", "sound.flac", "tune.mid", "hand.take", "a.motion", "song.mp3"):
        Path(name).write_bytes(b"RIFF\xfe")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert app.run(shlex.split(line)) == code
    out, err = capsys.readouterr()
    assert answer in " ".join((out + err).split())
    assert "Traceback" not in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_command_sections_list_each_command_once():
    listed = [name for names in app.SECTIONS.values() for name in names]
    assert sorted(listed) == sorted(app.COMMANDS)


def commands(group: LazyGroup, before: str = "") -> dict[str, click.Command]:
    """All commands by their words, also those of groups that do something by themselves."""
    result: dict[str, click.Command] = {}
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        path = f"{before}{name}"
        if isinstance(command, LazyGroup):
            result |= commands(command, f"{path} ")
        if not isinstance(command, LazyGroup) or command.invoke_without_command:
            result[path] = command
    return result


def test_help_examples_of_all_commands(capsys: pytest.CaptureFixture[str]):
    result = commands(app.group)
    assert set(result) == set(examples.EXAMPLES)
    for name in result:
        assert app.run([*name.split(), "--help"]) == 0
        out = capsys.readouterr().out
        for line, what in examples.EXAMPLES[name]:
            assert line in out
            assert what in out


LINES = [line for rows in examples.EXAMPLES.values() for line, _ in rows]


@pytest.mark.parametrize("line", LINES)
def test_help_example_lines_parse(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line)
    assert program == "ergon"
    if "piece.ergonpack" in words:  # a pack is opened where it is named
        Path("piece.yaml").write_text(SCORE)
        assert app.run(["pack", "piece.yaml"]) == 0
    command: click.Command = app.group
    context = click.Context(command, info_name="ergon")
    while isinstance(command, LazyGroup) and words:
        name, inner, words = command.resolve_command(context, words)
        assert inner is not None
        command, context = inner, click.Context(inner, parent=context, info_name=name)
    if not isinstance(command, LazyGroup):
        command.make_context(command.name, words, parent=context.parent)


@pytest.mark.parametrize("rate", ["48000", "48000Hz", "48kHz", "4.8e4"])
def test_render_rate_option_with_and_without_unit(
    rate: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Path("piece.yaml").write_text(SCORE)
    assert app.run(["render", "piece.yaml", "-n", "--rate", rate]) == 0
    assert "48000 Hz" in capsys.readouterr().out


def test_layout_noise_seconds_with_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    words = ["layout", "noise", "stereo", "--rate", "8kHz", "-o"]
    assert app.run([*words, "a.wav", "--seconds", "100ms"]) == 0
    assert app.run([*words, "b.wav", "--seconds", "0.1"]) == 0
    assert Path("a.wav").read_bytes() == Path("b.wav").read_bytes()


# (command line with an earlier spelling, with the present one, what the warning says)
RESPELT = [
    ("render piece.yaml -n --to 0.5s", "render piece.yaml -n --until 0.5s", "--until"),
    ("render piece.yaml -n --to=0.5s", "render piece.yaml -n --until=0.5s", "--until"),
    ("modes piece.yaml --to 2kHz", "modes piece.yaml --upto 2kHz", "--upto"),
    ("stats piece.yaml --to 2kHz", "stats piece.yaml --upto 2kHz", "--upto"),
    ("share none.yaml --to 1s", "share none.yaml --until 1s", "--until"),
    ("view piece.yaml --to 1s", "view piece.yaml --until 1s", "--until"),
    (
        "fold in.wav --to stereo --from dome24",
        "fold in.wav --to stereo --layout dome24",
        "--layout",
    ),
    ("import m.mdl --input a=b.wav", "import m.mdl --feed a=b.wav", "--feed"),
]


@pytest.mark.parametrize(("earlier", "present", "option"), RESPELT)
def test_deprecated_spelling_warns_with_same_result(
    earlier: str,
    present: str,
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Path("piece.yaml").write_text(SCORE)
    code = app.run(shlex.split(present))
    expected = capsys.readouterr()
    assert app.run(shlex.split(earlier)) == code
    answer = capsys.readouterr()
    warning, _, rest = answer.err.partition("\n")
    assert f"is written {option} now" in warning
    assert (answer.out, rest) == (expected.out, expected.err)


def test_option_names_mean_the_same_in_all_commands():
    meanings: dict[str, set[str]] = {}
    for name, command in commands(app.group).items():
        for param in command.params:
            for option in set(param.opts) & set(MEANINGS):
                metavar = str(param.metavar or param.type.name)
                meanings.setdefault(option, set()).add(metavar)
                assert metavar in MEANINGS[option], f"ergon {name} {option} {metavar}"
    assert set(meanings) == set(MEANINGS)


# What may follow an option: positions in time, whom sound or files are for, a file, nothing.
MEANINGS = {
    "--from": {"POSITION", "TIME"},
    "--until": {"POSITION", "TIME"},
    "--to": {"WHERE", "choice"},
    "--layout": {"WHAT"},
    "--input": {"FILE.wav"},
    "--strict": {"boolean"},
}


@pytest.mark.parametrize(("text", "code"), [("    - {at: 1|1.5, play: lean}", 1), ("", 0)])
def test_check_strict_exit_code_with_warning(
    text: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    first = "    - {at: A, play: knock, every: 1, times: 2}\n"
    Path("piece.yaml").write_text(SCORE.replace(first, f"{first}{text}\n"))
    assert app.run(["check", "piece.yaml"]) == 0
    assert app.run(["check", "piece.yaml", "--strict"]) == code
