"""Ergon: write the gesture, hear the matter.

`check`, `plan`, `modes`, `tune`, `admittance`, `stats`, `render`, `render_to_file` and `freeze`
take the path of a score, and options. `open_session` plays a score that is changed while it
plays; `fold_file` converts a sound file to other channels (headphones, stereo, Ambisonics,
another room); `take_stats` measures the hands of a recording; `bell` finds the modes of a struck
object; `sweep` renders variants of a score; `pack` writes a score with all that it reads into
one file, `unpack` its files into a folder. `play` plays a score to its end, `page` makes one file
of HTML that moves and sounds, `plot` draws a gesture or the notes, `export` writes parts for other
programs and `import_` reads models of them; `chart` holds error against cost. All errors are an
`ErgonError`. The page docs/library.md shows each.
"""

TYPE_CHECKING = False  # as in `typing`, which need not be imported
if TYPE_CHECKING:
    from ergon._core import PlanRow
    from ergon.api.admittance import Admittance, AdmittanceOptions, admittance
    from ergon.api.check import Checked, check
    from ergon.api.errors import (
        DeviceError,
        DivergedError,
        EngineExitError,
        OptionError,
        ScoreError,
    )
    from ergon.api.files import render_to_file
    from ergon.api.fold import Folded, FoldError, FoldOptions, fold_file
    from ergon.api.freeze import FreezeOptions, freeze
    from ergon.api.modes import ModesOptions, PartModes, modes
    from ergon.api.open_session import Session, open_session
    from ergon.api.options import (
        AccuracyOptions,
        FileOptions,
        PlayOptions,
        ReadOptions,
        RenderOptions,
        SessionOptions,
    )
    from ergon.api.packs import PackedFile, pack, unpack
    from ergon.api.page import Page, page
    from ergon.api.pictures import Picture
    from ergon.api.plan import Plan, plan
    from ergon.api.play_to_end import Played, play
    from ergon.api.plot import plot
    from ergon.api.render import Render, render
    from ergon.api.stats import LinkStats, PartStats, PointStats, StatsOptions, stats
    from ergon.api.sweep import Sweep, SweepOptions, sweep
    from ergon.api.sweep_table import SweepRow
    from ergon.api.take_stats import ForceStats, HandStats, TakeStatsOptions, take_stats
    from ergon.api.tune import Tuned, TunedValue, TuneOptions, tune
    from ergon.api.version import __version__ as __version__
    from ergon.common.errors import ErgonError
    from ergon.common.report import PrintedReport, Progress, Report
    from ergon.exchange.frozen import Frozen
    from ergon.exchange.pack import Pack, PackError
    from ergon.exchange.safe import FileRefusedError
    from ergon.notation.text.errors import Diagnostic
    from ergon.rendering.job import RenderedFile, RenderedFiles
    from ergon.repl.session.api import NotTaken
    from ergon.repl.session_protocol import Reply, State
    from ergon.scores.gesture.movement import MovementStats
    from ergon.workshop.api.bell import BellOptions, bell
    from ergon.workshop.api.exchanging import export, import_
    from ergon.workshop.api.export import ExportedPart, ExportOptions
    from ergon.workshop.api.model import ImportedModel, ModelOptions
    from ergon.workshop.bells.bell import Bell
    from ergon.workshop.lab.error_chart import ChartOptions, ErrorChart, chart

__all__ = [
    "AccuracyOptions",
    "Admittance",
    "AdmittanceOptions",
    "Bell",
    "BellOptions",
    "ChartOptions",
    "Checked",
    "DeviceError",
    "Diagnostic",
    "DivergedError",
    "EngineExitError",
    "ErgonError",
    "ErrorChart",
    "ExportOptions",
    "ExportedPart",
    "FileOptions",
    "FileRefusedError",
    "FoldError",
    "FoldOptions",
    "Folded",
    "ForceStats",
    "FreezeOptions",
    "Frozen",
    "HandStats",
    "ImportedModel",
    "LinkStats",
    "ModelOptions",
    "ModesOptions",
    "MovementStats",
    "NotTaken",
    "OptionError",
    "Pack",
    "PackError",
    "PackedFile",
    "Page",
    "PartModes",
    "PartStats",
    "Picture",
    "Plan",
    "PlanRow",
    "PlayOptions",
    "Played",
    "PointStats",
    "PrintedReport",
    "Progress",
    "ReadOptions",
    "Render",
    "RenderOptions",
    "RenderedFile",
    "RenderedFiles",
    "Reply",
    "Report",
    "ScoreError",
    "Session",
    "SessionOptions",
    "State",
    "StatsOptions",
    "Sweep",
    "SweepOptions",
    "SweepRow",
    "TakeStatsOptions",
    "TuneOptions",
    "Tuned",
    "TunedValue",
    "admittance",
    "bell",
    "chart",
    "check",
    "export",
    "fold_file",
    "freeze",
    "import_",
    "modes",
    "open_session",
    "pack",
    "page",
    "plan",
    "play",
    "plot",
    "render",
    "render_to_file",
    "stats",
    "sweep",
    "take_stats",
    "tune",
    "unpack",
]

# The module of each name, imported at first use: `ergon --help` needs none of them.
_PLACES = {
    "AccuracyOptions": "api.options",
    "Admittance": "api.admittance",
    "AdmittanceOptions": "api.admittance",
    "Bell": "workshop.bells.bell",
    "BellOptions": "workshop.api.bell",
    "ChartOptions": "workshop.lab.error_chart",
    "Checked": "api.check",
    "DeviceError": "api.errors",
    "Diagnostic": "notation.text.errors",
    "DivergedError": "api.errors",
    "EngineExitError": "api.errors",
    "ErgonError": "common.errors",
    "ErrorChart": "workshop.lab.error_chart",
    "ExportOptions": "workshop.api.export",
    "ExportedPart": "workshop.api.export",
    "FileOptions": "api.options",
    "FileRefusedError": "exchange.safe",
    "FoldError": "api.fold",
    "FoldOptions": "api.fold",
    "Folded": "api.fold",
    "ForceStats": "api.take_stats",
    "FreezeOptions": "api.freeze",
    "Frozen": "exchange.frozen",
    "HandStats": "api.take_stats",
    "ImportedModel": "workshop.api.model",
    "LinkStats": "api.stats",
    "ModelOptions": "workshop.api.model",
    "ModesOptions": "api.modes",
    "MovementStats": "scores.gesture.movement",
    "NotTaken": "repl.session.api",
    "OptionError": "api.errors",
    "Pack": "exchange.pack",
    "PackError": "exchange.pack",
    "PackedFile": "api.packs",
    "Page": "api.page",
    "PartModes": "api.modes",
    "PartStats": "api.stats",
    "Picture": "api.pictures",
    "Plan": "api.plan",
    "PlanRow": "_core",
    "PlayOptions": "api.options",
    "Played": "api.play_to_end",
    "PointStats": "api.stats",
    "PrintedReport": "common.report",
    "Progress": "common.report",
    "ReadOptions": "api.options",
    "Render": "api.render",
    "RenderOptions": "api.options",
    "RenderedFile": "rendering.job",
    "RenderedFiles": "rendering.job",
    "Reply": "repl.session_protocol",
    "Report": "common.report",
    "ScoreError": "api.errors",
    "Session": "api.open_session",
    "SessionOptions": "api.options",
    "State": "repl.session_protocol",
    "StatsOptions": "api.stats",
    "Sweep": "api.sweep",
    "SweepOptions": "api.sweep",
    "SweepRow": "api.sweep_table",
    "TakeStatsOptions": "api.take_stats",
    "TuneOptions": "api.tune",
    "Tuned": "api.tune",
    "TunedValue": "api.tune",
    "admittance": "api.admittance",
    "bell": "workshop.api.bell",
    "chart": "workshop.lab.error_chart",
    "check": "api.check",
    "export": "workshop.api.exchanging",
    "fold_file": "api.fold",
    "freeze": "api.freeze",
    "import_": "workshop.api.exchanging",
    "modes": "api.modes",
    "open_session": "api.open_session",
    "pack": "api.packs",
    "page": "api.page",
    "plan": "api.plan",
    "play": "api.play_to_end",
    "plot": "api.plot",
    "render": "api.render",
    "render_to_file": "api.files",
    "stats": "api.stats",
    "sweep": "api.sweep",
    "take_stats": "api.take_stats",
    "tune": "api.tune",
    "unpack": "api.packs",
}


def __getattr__(public_name: str) -> object:
    place_path = "api.version" if public_name == "__version__" else _PLACES.get(public_name)
    if place_path is None:
        raise AttributeError(f"module 'ergon' has no attribute '{public_name}'", name=public_name)
    from importlib import import_module

    attribute: object = getattr(import_module(f"ergon.{place_path}"), public_name)
    globals()[public_name] = attribute
    return attribute


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
