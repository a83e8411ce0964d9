"""Programs of Faust, compiled and run."""

import subprocess
from pathlib import Path

import numpy as np
from needed import needs

_MAIN = """
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>
#define FAUSTFLOAT double
struct Meta { void declare(const char*, const char*) {} };
struct UI { void openVerticalBox(const char*) {} void closeBox() {} };
struct dsp { virtual ~dsp() {} };
%s
int main(int, char** arguments) {
    mydsp one;
    one.init(std::atoi(arguments[1]));
    std::vector<double> in(one.getNumInputs() + 1), out(one.getNumOutputs());
    std::vector<double*> ins, outs;
    for (auto& x : in) ins.push_back(&x);
    for (auto& x : out) outs.push_back(&x);
    while (std::fread(in.data(), 8, in.size(), stdin) == in.size()) {
        one.compute(1, ins.data(), outs.data());
        std::fwrite(out.data(), 8, out.size(), stdout);
    }
}
"""
needs_faust = needs("faust", "g++")


def rendered(program: Path, fed: np.ndarray, rate: int) -> np.ndarray:
    """Outputs (n_frames, n_out) of a program for its inputs (n_frames, n_in)."""
    built = ["faust", "-lang", "cpp", "-double", str(program)]
    code = subprocess.run(built, check=True, capture_output=True, text=True).stdout
    source, binary = program.with_suffix(".cpp"), program.with_suffix(".run")
    source.write_text("#include <cstdlib>\n" + _MAIN.replace("%s", code))
    # No fused multiply-add: sums are rounded as written.
    options = ["-O1", "-ffp-contract=off"]
    subprocess.run(["g++", *options, str(source), "-o", str(binary)], check=True)
    # An additional column, so that a program without inputs also gets the number of frames.
    padded = np.column_stack([fed, np.zeros(len(fed))]).tobytes()
    done = subprocess.run(
        [str(binary.resolve()), str(rate)], input=padded, check=True, capture_output=True
    )
    return np.frombuffer(done.stdout).reshape(len(fed), -1)
