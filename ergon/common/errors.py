"""The root of ergon's errors.

    ErgonError
    ├ TextError            one mistake in a text: a score's field, a notation, a line of a session
    │ ├ TakeError          a file of a take that cannot be read
    │ └ TempoError         a tempo map that contradicts itself
    ├ StageError           a score that the engine does not play; its diagnostics have places
    ├ EditError            a change of a score's text that cannot be made
    ├ ModelError           a model of another program that cannot be read, or put into a score
    ├ NotRegularError, FileRefusedError, NotPlanError, NotFrozenError, NotRecordingError,
    │ NotWaveError,
    │ PackError            a file that cannot be read or may not be written
    ├ ClusterError,
    │ NotBundledError      other processes cannot compute what is asked of them
    └ ScoreError, OptionError, DeviceError, … of `ergon.api.errors`, which `import ergon` offers

The packages `live`, `repl` and `lab` add their own, each a direct child of the root. Errors of
the compiled core (`ergon._core.EngineError`, a ValueError) are outside the tree: the functions
of `import ergon` turn them into members of it.
"""

from __future__ import annotations


class ErgonError(Exception):
    """A refusal by ergon; its message is written for the user."""
