"""Version edits of phrases."""

from __future__ import annotations

from ergon.repl.language import commands as c
from ergon.repl.session.edit_table import edits_texts
from ergon.repl.session.version import Version
from ergon.scores.edits import phrases
from ergon.scores.edits.texts import Texts


@edits_texts(c.DefinePhrase)
def _define(command: c.DefinePhrase, version: Version, beat: float) -> Texts:
    words = command.words
    fields = {name: words[name].text for name in ("to", "length") if name in words}
    return phrases.define(version.texts, command.name, command.entries, fields)
