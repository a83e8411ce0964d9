"""The table of what is fuzzed; what each target is given stands in a file for each door."""

from tests.fuzz import (
    commands,
    file_targets,
    format_targets,
    lsp_targets,
    mesh_targets,
    model_targets,
    motion_targets,
    notation_targets,
    render_targets,
    score_targets,
    sessions,
    socket_targets,
)
from tests.fuzz.harness import Target

TARGETS = (
    *score_targets.TARGETS,
    # Scores that are refused, that are too large, and two that every command computes quickly.
    Target("commands", commands.case, commands.read, (), 18, 2_000, limit=60.0, short_first=17),
    *notation_targets.TARGETS,
    *file_targets.TARGETS,
    *format_targets.TARGETS,
    *motion_targets.TARGETS,
    *mesh_targets.TARGETS,
    *model_targets.TARGETS,
    *render_targets.TARGETS,
    *socket_targets.TARGETS,
    *lsp_targets.TARGETS,
    Target("journals", sessions.journal, sessions.read_journal, (), 20, 15_000, limit=30.0),
    Target("sessions", sessions.typed, sessions.read_typed, (), 20, 50_000, limit=30.0),
)
BY_NAME = {target.name: target for target in TARGETS}
