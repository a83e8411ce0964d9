"""What `ergon info` says of a motion file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Console, plural
from .outcome import Refused
from .units import octets_text, seconds_text

if TYPE_CHECKING:
    from ergon._core import Motion

_FLIGHTS_CHUNK, _FRAMES_CHUNK, _ERGONS_CHUNK, _CONTACTS_CHUNK = 3, 4, 5, 6
_WORDS_BY_KIND = {
    "free": "free",
    "sampled": "sampled",
    "modal": "by modes",
    "none": "not computed",
}


def read(path: Path) -> Motion:
    """Read the intact part of a motion file. Raises Refused."""
    from ergon import _core

    try:
        return _core.read_motion(path)
    except OSError as error:
        raise Refused(f"{path}: {error.strerror or error}") from None
    except _core.EngineError as error:
        raise Refused(f"{path}: {error}") from None


def motion(console: Console, path: Path) -> None:
    """Print the contents of a motion file, and whether it is complete."""
    from ergon.exchange.motion import read_manifest
    from ergon.exchange.motion_space import NotMotionError, points_of_parts

    archive = read(path)
    try:
        manifest = read_manifest(archive)
        points_by_part = points_of_parts(manifest, archive.names)
    except NotMotionError as error:
        raise Refused(f"{path}: {error}") from None
    bytes_by_kind: dict[int, int] = {}
    for chunk in archive.chunks():
        bytes_by_kind[chunk.kind] = bytes_by_kind.get(chunk.kind, 0) + chunk.size
    counts_by_name = {
        "flights": bytes_by_kind.get(_FLIGHTS_CHUNK, 0) // 12,
        "ergons": bytes_by_kind.get(_ERGONS_CHUNK, 0) // 20,
        "contacts": bytes_by_kind.get(_CONTACTS_CHUNK, 0) // 12,
    }
    file_state = "whole" if archive.is_whole else "cut" if archive.is_cut else "damaged"
    n_file_bytes = path.stat().st_size
    if console.json:
        console.record(
            "motion",
            file=str(path),
            state=file_state,
            title=manifest.get("title"),
            score_sha256=manifest.get("score_sha256"),
            plan_sha256=manifest.get("plan_sha256"),
            seed=manifest.get("seed"),
            duration_s=archive.duration,
            fps=manifest["fps"],
            points=sum(points_by_part),
            coordinates=len(archive.names),
            modes=manifest["modes"],
            bytes=n_file_bytes,
            bound=manifest.get("bound"),
            **counts_by_name,
            parts=manifest["parts"],
        )
        return
    info_lines = [
        f"{path}: {seconds_text(archive.duration)} at {manifest['fps']:g} frames a second, "
        f"{plural(sum(points_by_part), 'point')}, {octets_text(n_file_bytes)}, {file_state}"
    ]
    if manifest.get("title"):
        info_lines.append(f"title:   {manifest['title']}")
    for name in ("score", "plan"):
        if manifest.get(f"{name}_sha256"):
            info_lines.append(f"{name + ':':8} sha256 {manifest[f'{name}_sha256']}")
    info_lines.append(
        "holds:   " + ", ".join(f"{count:,} {name}" for name, count in counts_by_name.items())
    )
    if bounds_text := _bounds_text(manifest):
        info_lines.append(f"bound:   {bounds_text}")
    for part_manifest, point_count in zip(manifest["parts"], points_by_part, strict=True):
        if not point_count and part_manifest["count"]:
            continue  # its coordinates are those of points in another part
        reason_text = f" ({part_manifest['why']})" if part_manifest["why"] else ""
        modes = part_manifest["modes"]
        mode_count = f", {modes['count']:,} of {modes.get('of')} modes" if modes else ""
        info_lines.append(
            f"  {part_manifest['name']}: {plural(point_count, 'point')}, "
            f"{_WORDS_BY_KIND[part_manifest['kind']]}{reason_text}{mode_count}"
        )
    console.data("\n".join(info_lines) + "\n")


def _bounds_text(manifest: dict[str, Any]) -> str | None:
    """The error bounds of the displacements in words; None if the manifest has none."""
    error_bounds = manifest.get("bound")
    if not isinstance(error_bounds, dict):
        return None
    try:
        amplitude_error, rest_error, flight_error = (
            float(error_bounds[name]) for name in ("amplitude", "rest", "flight")
        )
    except (KeyError, TypeError, ValueError):
        return None
    part_kinds = {part["kind"] for part in manifest["parts"]}
    bound_words = []
    if "sampled" in part_kinds:
        bound_words.append(
            f"sampled points are right within {100 * amplitude_error:g} % of their own amplitude, "
            f"and at rest within {1e6 * rest_error:g} µm"
        )
    if part_kinds & {"free", "modal"}:
        bound_words.append(
            f"oscillations are right within {100 * flight_error:g} % of their amplitude"
        )
    return "; ".join(bound_words) or None
