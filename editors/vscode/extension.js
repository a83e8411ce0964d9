// Scores in VS Code: the language server, and commands that send lines to a session of ergon.
"use strict";

const vscode = require("vscode");
const { Client, Lit, place } = require("./client");
const { startServer } = require("./languages");

let channel;
let client;
let server;
let glow;
const lit = new Lit();

/** Mark what sounds, in every editor that shows its file. */
function light(sounding) {
  if (!lit.take(sounding, Date.now())) return;
  for (const editor of vscode.window.visibleTextEditors) {
    const { document } = editor;
    const textAt = (line, from, to) =>
      line < document.lineCount ? document.lineAt(line).text.slice(from, to) : "";
    const ranges = lit.ranges(document.uri.fsPath, textAt);
    editor.setDecorations(
      glow,
      ranges.map(({ line, from, to }) => new vscode.Range(line, from, line, to)),
    );
  }
}

function say(text, isError) {
  if (client !== undefined) tellContext();
  channel.appendLine(text);
  const first = text.split("\n")[0];
  if (isError) vscode.window.setStatusBarMessage(`$(warning) ${first}`, 8000);
  else vscode.window.setStatusBarMessage(first, 4000);
}

/** Keys of this extension mean something in scores, and everywhere once a session is joined. */
function tellContext() {
  const editor = vscode.window.activeTextEditor;
  const document = editor === undefined ? null : editor.document;
  const isScore = document !== null && document.languageId === "yaml" && /^ergon:/m.test(document.getText());
  vscode.commands.executeCommand("setContext", "ergon.isScore", isScore);
  vscode.commands.executeCommand("setContext", "ergon.joined", client.socket !== null);
}

async function connect() {
  const asked = vscode.workspace.getConfiguration("ergon").get("socket");
  try {
    await client.connect(asked || place());
  } catch (error) {
    say(error.message, true);
  }
}

/** The lines of the block around a line: up to the next empty ones. */
function block(document, line) {
  const isEmpty = (number) => document.lineAt(number).isEmptyOrWhitespace;
  let first = line;
  let last = line;
  while (first > 0 && !isEmpty(first - 1)) first -= 1;
  while (last + 1 < document.lineCount && !isEmpty(last + 1)) last += 1;
  const lines = [];
  for (let number = first; number <= last; number += 1) lines.push(document.lineAt(number).text);
  return lines.join("\n");
}

async function send(text) {
  if (client.socket === null) await connect();
  if (client.socket !== null) client.submit(text);
}

function activate(context) {
  channel = vscode.window.createOutputChannel("ergon");
  glow = vscode.window.createTextEditorDecorationType({
    backgroundColor: new vscode.ThemeColor("editor.findMatchHighlightBackground"),
    borderRadius: "2px",
  });
  context.subscriptions.push(glow);
  const isLit = vscode.workspace.getConfiguration("ergon").get("light") !== false;
  client = new Client(say, isLit ? light : undefined);
  const inEditor = (act) => () => {
    const editor = vscode.window.activeTextEditor;
    return editor === undefined ? undefined : act(editor);
  };
  const commands = {
    "ergon.connect": connect,
    "ergon.send": inEditor((editor) => {
      const { document, selection } = editor;
      return send(
        selection.isEmpty ? document.lineAt(selection.active.line).text : document.getText(selection),
      );
    }),
    "ergon.sendBlock": inEditor((editor) =>
      send(block(editor.document, editor.selection.active.line)),
    ),
    "ergon.panic": () => client.panic(),
    "ergon.leave": () => {
      client.leave();
      tellContext();
    },
  };
  for (const [name, act] of Object.entries(commands)) {
    context.subscriptions.push(vscode.commands.registerCommand(name, act));
  }
  context.subscriptions.push(channel, { dispose: () => client.leave() });
  context.subscriptions.push(vscode.window.onDidChangeActiveTextEditor(tellContext));
  tellContext();
  server = startServer(say);
}

async function deactivate() {
  if (client !== undefined) client.leave();
  const started = await server;
  if (started) await started.stop();
}

module.exports = { activate, deactivate, block };
