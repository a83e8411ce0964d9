// Starts `ergon lsp` for the scores that are open.
"use strict";

const vscode = require("vscode");

/** The client, or null where vscode-languageclient is not installed or the server does not start. */
async function startServer(say) {
  let node;
  try {
    node = require("vscode-languageclient/node");
  } catch {
    say("for completion in scores, run `npm install` in the folder of this extension", true);
    return null;
  }
  const command = vscode.workspace.getConfiguration("ergon").get("command") || "ergon";
  const server = { command, args: ["lsp"], transport: node.TransportKind.stdio };
  // The server answers about YAML that begins as a score does, and about no other.
  const documents = { documentSelector: [{ language: "yaml" }] };
  const client = new node.LanguageClient("ergon", "ergon", server, documents);
  try {
    await client.start();
    return client;
  } catch (error) {
    say(`\`${command} lsp\` does not start: ${error.message}`, true);
    return null;
  }
}

module.exports = { startServer };
