"""Orchestras of Csound, played into samples."""

import re
import subprocess
from pathlib import Path

import numpy as np
import soundfile
from needed import needs

needs_csound = needs("csound")


def rendered(orchestra: Path) -> np.ndarray:
    """Outputs (n_frames, n_out) of a `.csd`, in the units of its comments."""
    sound = orchestra.with_suffix(".wav")
    command = ["csound", "-m0", "-o", str(sound), str(orchestra)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr.lower().replace("0 errors", ""), done.stderr
    full = [float(one) for one in re.findall(r"^giFull\d+ = (\S+)", orchestra.read_text(), re.M)]
    samples, _ = soundfile.read(sound, always_2d=True)
    return np.asarray(samples * full)
