"""Version edits of phrases."""

from __future__ import annotations

from ergon.repl.language.phrases import DefinePhrase
from ergon.repl.session.edit_table import edits_texts
from ergon.repl.session.version import Version
from ergon.scores.edits import families, phrases
from ergon.scores.edits.texts import Texts


@edits_texts(DefinePhrase)
def _define_phrase(command: DefinePhrase, version: Version, beat: float) -> Texts:
    words = command.words
    phrase_fields = {name: words[name].text for name in ("to", "length") if name in words}
    struck_names = [word for entry in command.entries for word in entry["what"].split()]
    struck_names += filter(None, [command.to])
    texts, _ = families.with_definitions(version.texts, version.piece, struck_names)
    return phrases.define(texts, command.name, command.entries, phrase_fields)
