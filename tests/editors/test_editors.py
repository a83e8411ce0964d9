"""Clients of editors: a line and a block reach a session, and its answers are shown."""

import json
import re
import subprocess
from pathlib import Path

import pytest
from needed import needs
from patience import PATIENCE
from sockets import serving

from ergon.instruments.module_kinds import KINDS
from ergon.repl.session_protocol import SoundingPlace
from ergon.repl.wire import loopback
from ergon.scores.gesture.points import CURVES
from ergon.scores.gesture.transforms import MEANINGS as GESTURE_WORDS
from ergon.scores.pattern.cycle_table import MEANINGS as RHYTHM_WORDS
from ergon.scores.pattern.turn_chain import TURN_FORMS

EDITORS = Path(__file__).parents[2] / "editors"
PIECE = "tempo 72\n\nada plays knock\nleo plays lean  # ü\n\nadda\nfail\n"


@pytest.fixture(params=["", "loopback"], ids=["unix", "port"])
def kind_of_socket(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A session at a socket of Unix, and at a port, as on Windows."""
    monkeypatch.setenv(loopback.SOCKET_VARIABLE, request.param)


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


VIM = r"""
set nocompatible
let s:told = []
function! Answer(wanted) abort
  let l:left = 1500
  while g:ergon_answer !~# a:wanted && l:left > 0
    sleep 20m
    let l:left -= 1
  endwhile
  call add(s:told, g:ergon_answer)
  let g:ergon_answer = ''
endfunction
edit piece.txt
ErgonConnect there.sock
call Answer('^joined')
1ErgonSend
call Answer('^ok tempo')
call cursor(3, 1)
execute "normal \<Plug>(ErgonBlock)"
call Answer('^ok')
6ErgonSend
call Answer('^not taken')
7ErgonSend
call Answer('error')
ErgonPanic
call Answer('^panic')
ErgonLeave
ErgonConnect nowhere.sock
call Answer('^no session')
call writefile([json_encode(s:told)], 'told.json')
qall!
"""


@needs("vim")
@pytest.mark.usefixtures("kind_of_socket")
def test_vim_client_sends_lines_and_blocks(tmp_path: Path):
    (tmp_path / "piece.txt").write_text(PIECE, encoding="utf-8")
    (tmp_path / "test.vim").write_text(VIM, encoding="utf-8")
    plugin = EDITORS / "vim" / "plugin" / "ergon.vim"
    with serving(tmp_path / "there.sock") as session:
        command = ["vim", "-Nu", "NONE", "-i", "NONE", "-n", "-es", "-S", str(plugin)]
        run([*command, "-S", "test.vim"], tmp_path)
    output = json.loads((tmp_path / "told.json").read_text())
    block = "ada plays knock\nleo plays lean  # ü"
    assert output[:4] == [
        "joined s",
        "ok tempo 72",
        f"ok {block[:20]}",
        "not taken: unknown verb\ntry: ada\n⣀⡠\nb",
    ]
    assert "internal error" in output[4]
    assert output[5] == "panic: no sound, no force; `release` ends it"
    assert "ergon repl SCORE --socket begins one" in output[6]
    assert session.lines == ["tempo 72", block, "adda", "fail"]
    assert session.panicked.is_set()


NODE = r"""
const { Client } = require(process.argv[2] + "/client.js");
const Module = require("module");
const told = [];
const commands = {};
const contexts = [];
const marks = [];
let looked;
let text = "gain -3dB";
const lines = require("fs").readFileSync("piece.txt", "utf8").split("\n");
const editor = {
  document: {
    lineCount: lines.length,
    lineAt: (n) => ({ text: lines[n], isEmptyOrWhitespace: lines[n].trim() === "" }),
    getText: () => text,
    languageId: "yaml",
    uri: { fsPath: process.cwd() + "/piece.txt" },
  },
  setDecorations: (kind, ranges) => marks.push(ranges.map(({ a, b, c, d }) => [a, b, c, d])),
  selection: { isEmpty: true, active: { line: 0 } },
};
const vscode = {
  Range: class { constructor(a, b, c, d) { Object.assign(this, { a, b, c, d }); } },
  ThemeColor: class {},
  window: {
    createTextEditorDecorationType: () => ({ dispose() {} }),
    visibleTextEditors: [editor],
    createOutputChannel: () => ({ appendLine: (text) => told.push(text), dispose() {} }),
    setStatusBarMessage() {},
    onDidChangeActiveTextEditor: (act) => ((looked = act), { dispose() {} }),
    activeTextEditor: editor,
  },
  workspace: {
    getConfiguration: () => ({ get: (name) => (name === "socket" ? "there.sock" : "") }),
  },
  commands: {
    registerCommand: (name, act) => ((commands[name] = act), { dispose() {} }),
    executeCommand: (name, key, value) => contexts.push([name, key, value]),
  },
};
const started = [];
class LanguageClient {
  constructor(id, name, server, documents) {
    this.start = async () => started.push({ server, documents });
  }
}
const languages = { LanguageClient, TransportKind: { stdio: 0 } };
const mocked = { vscode, "vscode-languageclient/node": languages };
const load = Module._load;
Module._load = (name, ...rest) => mocked[name] ?? load(name, ...rest);
const extension = require(process.argv[2] + "/extension.js");
extension.activate({ subscriptions: [] });
const until = async (count) => {
  while (told.length < count) await new Promise((done) => setTimeout(done, 5));
};
(async () => {
  await commands["ergon.send"]();
  await until(2);
  editor.selection.active.line = 3;
  await commands["ergon.sendBlock"]();
  await until(3);
  editor.selection.isEmpty = false;
  await commands["ergon.send"]();
  await until(4);
  editor.selection = { isEmpty: true, active: { line: 5 } };
  await commands["ergon.send"]();
  await until(5);
  commands["ergon.panic"]();
  await until(6);
  while (marks.length < 2) await new Promise((done) => setTimeout(done, 5));
  const joined = contexts.at(-1);
  commands["ergon.leave"]();
  const left = contexts.at(-1);
  text = "ergon: 1\ntitle: A score";
  looked();
  const score = contexts.at(-2);
  const other = new Client(() => {});
  await other.connect("nowhere.sock").catch((error) => told.push(error.message));
  const names = Object.keys(commands);
  console.log(JSON.stringify({ told, started, joined, left, score, marks, commands: names }));
})();
"""


@needs("node")
@pytest.mark.usefixtures("kind_of_socket")
def test_vs_code_client_sends_lines_and_blocks(tmp_path: Path):
    (tmp_path / "piece.txt").write_text(PIECE, encoding="utf-8")
    (tmp_path / "test.js").write_text(NODE, encoding="utf-8")
    with serving(tmp_path / "there.sock") as session:
        file = str(tmp_path / "piece.txt")
        session.sounding = [
            SoundingPlace(file, 3, 11, "knock", 0.9, 1.0, "knock"),
            SoundingPlace(file, 4, 11, "knock", 0.9, 30.0, "knock"),  # other text stands there
            SoundingPlace("elsewhere.yaml", 1, 1, "tempo", 0.9, 30.0, "tempo"),
        ]
        output = json.loads(run(["node", "test.js", str(EDITORS / "vscode")], tmp_path))
    block = "ada plays knock\nleo plays lean  # ü"
    [server] = output["started"]
    assert server["server"] == {"command": "ergon", "args": ["lsp"], "transport": 0}
    assert server["documents"] == {"documentSelector": [{"language": "yaml"}]}
    assert output["told"] == [
        "joined s",
        "ok tempo 72",
        f"ok {block[:20]}",
        "ok gain -3dB",
        "not taken: unknown verb\ntry: ada\n⣀⡠\nb",
        "panic: no sound, no force; `release` ends it",
        "no session is served at nowhere.sock: ergon repl SCORE --socket begins one",
    ]
    assert session.lines == ["tempo 72", block, "gain -3dB", "adda"]
    assert session.panicked.is_set()
    package = json.loads((EDITORS / "vscode" / "package.json").read_text())
    # Lit, and dark again when it has ended.
    assert output["marks"][0] == [[2, 10, 2, 15]]
    assert output["marks"][-1] == []
    assert output["joined"] == ["setContext", "ergon.joined", True]
    assert output["left"] == ["setContext", "ergon.joined", False]
    assert output["score"] == ["setContext", "ergon.isScore", True]
    for binding in package["contributes"]["keybindings"]:  # elsewhere keys are the editor's
        assert binding["when"] in (
            "ergon.joined",
            "editorTextFocus && (ergon.joined || ergon.isScore)",
        )
        assert binding["key"] != "f12"  # which leads to a definition
    declared = [one["command"] for one in package["contributes"]["commands"]]
    assert sorted(declared) == sorted(output["commands"])


LISP = """
(setq ergon-socket (expand-file-name "there.sock"))
(defvar told nil)
(defun answer (wanted)
  (let ((left 1500))
    (while (and (> left 0) (not (string-match-p wanted ergon-answer)))
      (accept-process-output nil 0.02)
      (setq left (1- left))))
  (push ergon-answer told)
  (setq ergon-answer ""))
(find-file "piece.txt")
(ergon-mode 1)
(ergon-send-line)
(answer "^ok tempo")
(forward-line 2)
(ergon-send-block)
(answer "^ok")
(goto-char (point-min))
(forward-line 5)
(ergon-send-line)
(answer "^not taken")
(ergon-panic)
(answer "^panic")
(ergon-leave)
(princ (json-encode (vconcat (reverse told))))
"""


@needs("emacs")
@pytest.mark.usefixtures("kind_of_socket")
def test_emacs_client_sends_lines_and_blocks(tmp_path: Path):
    (tmp_path / "piece.txt").write_text(PIECE, encoding="utf-8")
    (tmp_path / "test.el").write_text(LISP, encoding="utf-8")
    with serving(tmp_path / "there.sock") as session:
        client = str(EDITORS / "emacs" / "ergon.el")
        run(["emacs", "-Q", "--batch", "-l", client, "-l", "test.el"], tmp_path)
    assert session.lines[0] == "tempo 72"
    assert "ada plays knock\nleo plays lean  # ü" in session.lines[1]
    assert session.lines[2] == "adda"
    assert session.panicked.is_set()


COLOURED = """
(find-file "piece.yaml")
(conf-mode)
(ergon-colour)
(font-lock-ensure)
(princ (json-encode
        (mapcar (lambda (word)
                  (goto-char (point-min))
                  (search-forward word)
                  (format "%s" (get-text-property (match-beginning 0) 'face)))
                '("BUT" "smooth" "mm@60ms" "Hz" "mf"))))
"""


@needs("emacs")
def test_emacs_colours_words_of_scores(tmp_path: Path):
    text = (
        "ergon: 1\n"
        "gestures: {knock: 0mm@0 smooth 6mm@60ms}\n"
        "strikes: {s: {to: b.m, at: 1|1, impulse: mf}}\n"
        "instruments: {b: {modules: {m: {CEL: {f: 220Hz}}, c: {BUT: {between: [k, m]}}}}}\n"
    )
    (tmp_path / "piece.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "test.el").write_text(COLOURED, encoding="utf-8")
    client = str(EDITORS / "emacs" / "ergon.el")
    printed = run(["emacs", "-Q", "--batch", "-l", client, "-l", "test.el"], tmp_path)
    assert json.loads(printed) == [
        "font-lock-type-face",
        "font-lock-keyword-face",
        "font-lock-builtin-face",
        "font-lock-builtin-face",
        "font-lock-constant-face",
    ]


def test_emacs_client_forms_and_names_are_complete():
    """Where no Emacs is installed: every form is closed, and every name of its own is defined."""
    text = (EDITORS / "emacs" / "ergon.el").read_text(encoding="utf-8")
    forms = list(_forms(text))
    assert forms[-1] == "(provide 'ergon)"
    built = r"\((?:defun|defvar|defconst|defcustom|define-minor-mode|defgroup) (ergon[\w-]*)"
    defined = {match[1] for form in forms for match in re.finditer(built, form)}
    bare = re.sub(r'"(?:[^"\\]|\\.)*"|;[^\n]*', '""', text)
    used = set(re.findall(r"(?<![\w-])ergon-[\w-]+", bare))
    assert used - defined <= {"ergon-mode-map"} - defined


def _forms(text: str):
    """Top-level forms of Lisp; a bracket that is left open or closed twice is a mistake."""
    depth, start, position = 0, 0, 0
    while position < len(text):
        character = text[position]
        if character == ";":
            position = text.index("\n", position)
        elif character == '"':
            position += 1
            while text[position] != '"':
                position += 2 if text[position] == "\\" else 1
        elif character == "?" and text[position - 1] in " (":
            position += 2 if text[position + 1] == "\\" else 1
        elif character == "(":
            start = position if depth == 0 else start
            depth += 1
        elif character == ")":
            depth -= 1
            assert depth >= 0, text[start:position]
            if depth == 0:
                yield text[start : position + 1]
        position += 1
    assert depth == 0, text[start:]


@pytest.mark.parametrize(
    ("line", "name", "outcome"),
    [
        ("knock: 0mm@0 smooth 6mm@1/8 -2mm@250ms", 0, ["0mm@0", "6mm@1/8", "-2mm@250ms"]),
        ("knock: 0mm@0 smooth 6mm@1/8 hold 0mm@1", 1, ["smooth", "hold"]),
        ("m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}", 2, ["2g", "220Hz", "2.5s"]),
        ("m: {CEL: {M: 2g}}, out: {SOX: m}", 3, ["CEL", "SOX"]),
        ("f: C#4, notes: A3 C4+20cents E4", 4, ["C#4", "A3", "C4+20cents", "E4"]),
        ("smooth-bell: {like: line}", 1, []),
    ],
)
def test_vs_code_grammar_matches_notation(line: str, name: int, outcome: list[str]):
    grammar = json.loads((EDITORS / "vscode/syntaxes/notation.tmLanguage.json").read_text())
    pattern = re.compile(grammar["patterns"][name]["match"])
    assert [match.group() for match in pattern.finditer(line)] == outcome


@pytest.mark.parametrize(
    ("name", "line", "words"), [(1, "0mm@0 {} 6mm@1/8", CURVES), (3, "m: {{{}: {{}}}}", KINDS)]
)
def test_vs_code_grammar_covers_program_words(name: int, line: str, words: tuple[str, ...]):
    grammar = json.loads((EDITORS / "vscode/syntaxes/notation.tmLanguage.json").read_text())
    pattern = re.compile(grammar["patterns"][name]["match"])
    missing = [word for word in words if word not in pattern.findall(line.format(word))]
    assert not missing


def transformations() -> list[str]:
    return sorted({*GESTURE_WORDS, *RHYTHM_WORDS, *TURN_FORMS})


def test_vs_code_grammar_covers_transformations_after_do():
    grammar = json.loads((EDITORS / "vscode/syntaxes/notation.tmLanguage.json").read_text())
    (rule,) = (rule for rule in grammar["patterns"] if "begin" in rule)
    begin, end = re.compile(rule["begin"]), re.compile(rule["end"])
    (inner,) = (re.compile(each["match"]) for each in rule["patterns"])
    for line in ("do: [{}, fast 2]", "ada do every 4 ({}, fast 2)", 'x: {{do: "{} 2, fast"}}'):
        for word in transformations():
            text = line.format(word)
            started = begin.search(text)
            assert started is not None
            stop = end.search(text, started.end()).start()
            assert word in inner.findall(text, started.end(), stop), text
    assert begin.search("every: 4") is None


@pytest.mark.parametrize(
    ("line", "strengths"),
    [
        ("impulse: f p mf -> fff", ["f", "p", "mf", "fff"]),
        ('"kick:f! ~ snare:pp..mf"', ["f!", "pp", "mf"]),
        ("m: {f: A3, p: 1}", []),
        ("{to: kick, impulse: v64}", ["v64"]),
    ],
)
def test_vs_code_grammar_matches_strengths(line: str, strengths: list[str]):
    grammar = json.loads((EDITORS / "vscode/syntaxes/notation.tmLanguage.json").read_text())
    (rule,) = (rule for rule in grammar["patterns"] if rule["comment"] == "strengths")
    assert [match.group() for match in re.finditer(rule["match"], line)] == strengths


@pytest.mark.parametrize(
    ("line", "keywords"),
    [
        ("      for i in 1..12: {m(i): {SOL: {}}}", ["for", "in"]),
        ("  for row in 0..n-1 by 2:", ["for", "in", "by"]),
        ("    if i mod 2 == 0:", ["if"]),
        ("    format: {SOL: {}}", []),
    ],
)
def test_vs_code_grammar_matches_loops(line: str, keywords: list[str]):
    grammar = json.loads((EDITORS / "vscode/syntaxes/notation.tmLanguage.json").read_text())
    (rule,) = (rule for rule in grammar["patterns"] if rule["comment"].startswith("loops"))
    match = re.search(rule["match"], line)
    assert [word for word in match.groups() if word] == keywords if match else not keywords


VIM_NAMES = r"""
set nocompatible
syntax on
edit s.yaml
set filetype=yaml
let s:names = {}
for s:line in range(1, line('$'))
  for s:column in range(1, col([s:line, '$']) - 1)
    let s:group = synIDattr(synID(s:line, s:column, 1), 'name')
    let s:names[s:group] = get(s:names, s:group, '') . getline(s:line)[s:column - 1]
  endfor
endfor
call writefile([json_encode(s:names)], 'names.json')
qall!
"""


@needs("vim")
def test_vim_colours_words_of_scores(tmp_path: Path):
    words = transformations()
    rows = "".join(f"  s{i}: {{do: 'every 4 ({word}, fast 2)'}}\n" for i, word in enumerate(words))
    text = "ergon: 1\nx: {CEL: {M: 400g}}  # rev f\ng: 0mm@0 smooth 6mm@1\n"
    text += "s: {impulse: f p mf, every: 1}\nstrikes:\n"
    (tmp_path / "s.yaml").write_text(text + rows, encoding="utf-8")
    (tmp_path / "test.vim").write_text(VIM_NAMES, encoding="utf-8")
    folder = EDITORS / "vim"
    paths = f"set runtimepath^={folder} runtimepath+={folder}/after"
    command = ["vim", "-Nu", "NONE", "-i", "NONE", "-n", "-es", "--cmd", paths, "-S", "test.vim"]
    run(command, tmp_path)
    names = json.loads((tmp_path / "names.json").read_text())
    assert names["ergonTransformation"] == "".join(f"every{word}fast" for word in words)
    assert names["ergonStrength"] == "fpmf"
    assert names["ergonCurve"] == "smooth"
    assert names["ergonKind"] == "CEL"
    assert names["ergonUnit"] == "gmmmm"
