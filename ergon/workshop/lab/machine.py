"""The machine on which something was measured."""

from __future__ import annotations

import os
import platform
from pathlib import Path


def cpu() -> str:
    """The name of the processor."""
    cpuinfo_path = Path("/proc/cpuinfo")
    lines = cpuinfo_path.read_text().splitlines() if cpuinfo_path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown processor"


def machine() -> str:
    """Processor, cores and system, in one line."""
    return f"{cpu()}, {os.cpu_count() or 1} cores, {platform.system()} {platform.machine()}"
