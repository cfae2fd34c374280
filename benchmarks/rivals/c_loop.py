"""The same scheme in C, compiled here with gcc: what this processor can do at best."""

import ctypes
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

# Threads that spin while they wait would take the cores from whoever is measured next.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

MISSING = "gcc is not installed"


def available() -> bool:
    """Whether there is a compiler."""
    return shutil.which("gcc") is not None


def build(lanes: int = 64) -> ctypes.CDLL:
    """The compiled `lugre.c`, with `lanes` drives side by side."""
    source = Path(__file__).parent / "lugre.c"
    folder = Path(tempfile.mkdtemp())
    compiled, library = folder / "lugre.o", folder / "lugre.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC", f"-DLANES={lanes}"]
    width = ["-mprefer-vector-width=512"] if platform.machine() in ("x86_64", "AMD64") else []
    _gcc(*flags, *width, "-c", str(source), "-o", str(compiled))
    # Linked without -ffast-math: with it, loading the library would flush small numbers to zero in all of the process.
    _gcc("-shared", "-fopenmp", str(compiled), "-o", str(library), "-lm")
    return ctypes.CDLL(str(library))


def _gcc(*arguments: str) -> None:
    done = subprocess.run(["gcc", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"gcc could not build the C loop: {done.stderr.strip()}")


def runner(
    library: ctypes.CDLL,
    parameters: np.ndarray,
    force: np.ndarray,
    dt: float,
    *,
    substeps: int,
    keep_all: bool,
    lanes: int = 64,
) -> Callable[[], np.ndarray]:
    """A function that simulates all drives from rest: `parameters` (b, 7), `force` (n,); b is filled up to a multiple
    of `lanes`, as given to `build`. It returns the last positions, shape (b,), or all, shape (n, b)."""
    count, samples = parameters.shape[0], force.shape[0]
    filled = -(-count // lanes) * lanes
    table = np.ascontiguousarray(parameters[np.minimum(np.arange(filled), count - 1)].T)
    force = np.ascontiguousarray(force)
    out = np.zeros((samples, filled) if keep_all else filled)
    double = ctypes.POINTER(ctypes.c_double)

    def run() -> np.ndarray:
        library.simulate(
            *(filled, samples, substeps, table.ctypes.data_as(double), force.ctypes.data_as(double)),
            *(ctypes.c_double(dt), out.ctypes.data_as(double), int(keep_all)),
        )
        return out[..., :count]

    return run
