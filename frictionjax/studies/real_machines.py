"""Real machines with published recordings: files found on this disk by checksum, cut as in the notebook.

The files do not come with the library, because their licences differ. `load_machine` says where to get those that
it does not find.
"""

import hashlib
import importlib
import importlib.util
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float
from platformdirs import user_data_path

from frictionjax.core import InputError
from frictionjax.recordings import Case
from frictionjax.recordings.case import case_from_table

VARIABLE = "FRICTIONJAX_DATA"
"""Environment variable: folders to search, separated as in PATH."""

_FETCHER = "nonlinear_benchmarks"  # an extra: loaded only where it is asked for


class Machine(eqx.Module):
    """A machine whose recordings are published.

    **Attributes:** `title` (what it is), `known` (what others have published about its physics), `source` (where to
    get its recordings, a sentence), `files` (name -> SHA-256), `table` (from where the files are, and
    a folder for what must be converted, to the keys of a case file).
    """

    title: str = eqx.field(static=True)
    known: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    files: Mapping[str, str] = eqx.field(static=True)
    table: Callable[[Mapping[str, Path], Path], dict[str, Any]] = eqx.field(static=True)


def load_machine(name: str, folders: Sequence[str | Path] | None = None, *, download: bool = False) -> Case:
    """The recordings of one of `MACHINES` as a `Case`.

    **Arguments:** and **Raises:** as `files_of`.
    """
    found = files_of(name, folders, download=download)
    with tempfile.TemporaryDirectory() as folder:
        return case_from_table(MACHINES[name].table(found, Path(folder)), name)


def files_of(
    name: str, folders: Sequence[str | Path] | None = None, *, download: bool = False
) -> dict[str, Path]:
    """Where the files of one of `MACHINES` are on this disk, by name.

    **Arguments:**

    - `name`: which machine.
    - `folders`: where to search, subfolders included; absent: those that the environment variable `FRICTIONJAX_DATA`
      names, and the user's data folder of frictionjax.
    - `download`: let the package `nonlinear-benchmarks` fetch what is missing (EMPS only).

    **Raises:** `InputError` for an unknown name, where a file is missing or is not the one that was published, and
    where what is missing cannot be fetched; it says where to get it.
    """
    if name not in MACHINES:
        raise InputError(f'there is no machine "{name}"', cure=f"Choose one of {', '.join(MACHINES)}")
    machine = MACHINES[name]
    searched = [Path(folder) for folder in (_folders() if folders is None else folders)]
    found = {}
    for file, checksum in machine.files.items():
        candidates, match = _search(file, checksum, searched)
        if match is None and download and name == "emps":
            searched += _fetched_by_nonlinear_benchmarks(machine)
            candidates, match = _search(file, checksum, searched)
        if match is None:
            problem = (
                f"{file} of {machine.title} is not on this disk"
                if not candidates
                else f"{candidates[0]} is not the file that was published (its SHA-256 differs)"
            )
            raise InputError(problem, cure=f"{machine.source} Put it into a folder that {VARIABLE} names")
        found[file] = match
    return found


def load_speed_error(
    motor: Float[np.ndarray, " n"],
    load: Float[np.ndarray, " n"],
    frequency: float,
    damping: float,
    drag: float,
) -> float:
    """Relative error of the load's speed as a spring would transmit it from the motor: root mean square over the
    excited lines, over that of the load's measured speed.

    A load behind a spring, J2 (x2'' + drag x2') = k (x1 - x2) + c (x1' - x2'), turns with
    (2 zeta s + 1)/(s^2 + (2 zeta + d) s + 1) of the motor's speed; s = i f/f_a, d = drag/(2 pi f_a).

    **Arguments:**

    - `motor`, `load`: the speeds of the motor bench, one unit, shape `(n,)`; they count in opposite directions.
    - `frequency`: antiresonance f_a, Hz; infinite for a stiff shaft.
    - `damping`: damping ratio zeta of the spring.
    - `drag`: viscous friction of the load over its inertia, 1/s.
    """
    settled = slice(_SETTLING * _BENCH_PERIOD, motor.size // _BENCH_PERIOD * _BENCH_PERIOD)
    means = (np.mean(speed[settled].reshape(-1, _BENCH_PERIOD), axis=0) for speed in (motor, load))
    motor_line, load_line = (np.fft.rfft(mean) for mean in means)
    lines = np.flatnonzero(np.abs(motor_line) > _EXCITED * np.max(np.abs(motor_line)))  # multiples of 1 Hz
    s = 1j * lines / frequency
    own = drag / (2.0 * np.pi * frequency)
    passed = (2.0 * damping * s + 1.0) / (s**2 + (2.0 * damping + own) * s + 1.0)
    missed = load_line[lines] + passed * motor_line[lines]
    return float(np.linalg.norm(missed) / np.linalg.norm(load_line[lines]))


_BENCH_PERIOD, _SETTLING = 2500, 2  # samples of a period of the bench's multisine; periods left out
_EXCITED = 0.05  # of the largest line


def _folders() -> Iterator[Path]:
    yield from (Path(folder) for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder)
    yield user_data_path("frictionjax")


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _search(file: str, checksum: str, folders: Sequence[Path]) -> tuple[list[Path], Path | None]:
    """The files of that name in the `folders`, and the first of them that is the published one."""
    candidates = [path for folder in folders for path in sorted(folder.rglob(file)) if path.is_file()]
    return candidates, next((path for path in candidates if _checksum(path) == checksum), None)


def _fetched_by_nonlinear_benchmarks(machine: Machine) -> list[Path]:
    if importlib.util.find_spec(_FETCHER) is None:
        raise InputError(
            f"{machine.title} is not on this disk, and nonlinear-benchmarks, which fetches it, is not installed",
            cure='Run pip install "frictionjax[benchmarks-data]"',
        )
    fetch = importlib.import_module(_FETCHER).EMPS
    try:
        files = [Path(file) for file in fetch(data_file_locations=True)]
        if not all(file.is_file() for file in files):  # an archive of an earlier, damaged download
            files = [Path(file) for file in fetch(data_file_locations=True, force_download=True)]
    except Exception as error:  # the package raises what the network did, or a bare Exception
        raise InputError(
            f"nonlinear-benchmarks could not fetch {machine.title} ({type(error).__name__})",
            cure=f"Check the network connection, or get {' and '.join(machine.files)} from nonlinearbenchmark.org by "
            f"hand and put them into a folder that {VARIABLE} names",
        ) from error
    return sorted({file.parent for file in files})


def _emps(files: Mapping[str, Path], _: Path) -> dict[str, Any]:
    columns = {"t": "t", "u": "vir", "x": "qm", "reference": "qg"}
    roles = {"DATA_EMPS.mat": "fit", "DATA_EMPS_PULSES.mat": "holdout"}
    return {
        "plant": {
            "motor_constant": 35.1507,  # N/V
            "position_unit": "m",
            "force_unit": "N",
            "input_unit": "V",
            "encoder_step": 5e-8,
        },
        "recording": [
            {"file": str(files[name]), "columns": columns, "role": role, "loop": "closed"}
            for name, role in roles.items()
        ],
    }


def _motor_bench(files: Mapping[str, Path], _: Path) -> dict[str, Any]:
    # The torque constant is not documented: forces are per ampere. The load's speed is not read.
    columns = {"u": "iq_adx", "x": "theta_mx"}
    roles = {"MultisineTypeA.mat": "fit", "MultisineTypeB.mat": "holdout"}
    return {
        "plant": {"position_unit": "rad", "force_unit": "A", "input_unit": "A"},
        "recording": [
            {"file": str(files[name]), "sample_rate": 2500.0, "columns": columns, "role": role}
            for name, role in roles.items()
        ],
    }


_FIRST_CYCLE, _CYCLES, _PERIOD = 10.0, 24, 4.0
"""s, how many, s: the cycles after running in."""


def _tribometer(files: Mapping[str, Path], _: Path) -> dict[str, Any]:
    file = str(files["test_data_2.txt"])
    columns = {"t": "Time [s]", "x": "Position [mm]", "force": "Friction [uN]", "normal_force": "Normal [uN]"}
    recordings = []
    for number in range(_CYCLES):
        begin = _FIRST_CYCLE + _PERIOD * number
        recordings.append(
            {
                "file": file,
                "drive": "motion",
                "columns": columns,
                "scale": {"x": 1e-3, "force": -1e-6, "normal_force": 1e-6},
                "interval": [begin, begin + _PERIOD],
                "role": "holdout" if number % 2 else "fit",
            }
        )
    return {"plant": {"position_unit": "m", "force_unit": "N"}, "recording": recordings}


_FULL_DUTY = 885.0  # of the pulse-width register
_ENCODER = 2.0 * np.pi / 4096.0
_LOG_RATE = 188.0  # Hz
_HELD_OUT_GAIN = 200  # of the servo's controller


def _pendulum(files: Mapping[str, Path], folder: Path) -> dict[str, Any]:
    recordings = []
    for path in files.values():
        log = json.loads(path.read_text())
        rows = log["entries"]
        duty = np.array([row["load"] for row in rows], float)
        duty = np.where(duty > 32767.0, duty - 65536.0, duty) / _FULL_DUTY
        stamps = np.array([row["timestamp"] for row in rows], float)
        # The stamps wander by 0.15 ms about 188 Hz: one rate for all logs.
        t = np.arange(stamps[0], stamps[-1], 1.0 / _LOG_RATE)
        applied = np.maximum(np.searchsorted(stamps, t + 0.5 / _LOG_RATE, side="right") - 1, 0)
        u = (duty * np.array([row["input_volts"] for row in rows]))[applied]
        x = np.interp(t, stamps, np.array([row["position"] for row in rows], float))
        name = f"gain_{log['kp']}_{log['trajectory']}.csv"
        np.savetxt(
            folder / name, np.stack([u, x], axis=1), delimiter=",", header="u,x", comments="", fmt="%.9g"
        )
        role = "holdout" if log["kp"] == _HELD_OUT_GAIN else "fit"
        entry = {"file": str(folder / name), "sample_rate": _LOG_RATE, "role": role, "loop": "closed"}
        recordings.append(entry)
    # What the volts do through the winding is not documented: forces are per volt.
    plant = {"position_unit": "rad", "force_unit": "V", "input_unit": "V", "encoder_step": _ENCODER}
    return {"plant": plant, "recording": recordings}


MACHINES: dict[str, Machine] = {
    "emps": Machine(
        "EMPS, a ball screw with a DC motor",
        "its friction is known to be asymmetric, and a ripple of 2.51 mm is locked to the position",
        'nonlinearbenchmark.org has it; load_machine("emps", download=True) fetches it.',
        {
            "DATA_EMPS.mat": "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
            "DATA_EMPS_PULSES.mat": "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
        },
        _emps,
    ),
    "motor_bench": Machine(
        "a motor bench with two inertias and a flexible coupling",
        "its response has an antiresonance near 50 Hz and a resonance near 70 Hz, and the load's speed was measured",
        "It is in WataruOhnishi/FdiTools_Python on GitHub, MATLAB/Examples/private.",
        {
            "MultisineTypeA.mat": "a15dadc2e756ceddd927935f9c4c547cdcaef95c8611fc39087c848b3a8acb26",
            "MultisineTypeB.mat": "5618374be2c4c9c4eef5b180eb5bc64c82c5bd216c025d363b547d0ccc83dc11",
        },
        _motor_bench,
    ),
    "tribometer": Machine(
        "a reciprocating tribometer",
        "its contact yields over 100 um, first stiffer and then softer, as no LuGre bristle does",
        "It is in jchristopherson/FrictionModels.jl on GitHub, examples/test_data_2.txt.",
        {"test_data_2.txt": "e0abf58da8288eebe180a8fe191f1f223a5e1c43025e37c3db7cfb03ce9488a5"},
        _tribometer,
    ),
    "pendulum": Machine(
        "a pendulum of 0.49 kg and 0.1 m on a Dynamixel XL330 servo",
        "gravity takes 5.0 V on its winding per unit of sin x, and the gears' friction grows with the load",
        "It is in the history of Rhoban/bam on GitHub, bam/data.bak of January 2026.",
        {
            "2026-01-15_10h28m10.json": "e58f3c2a08a5e0e37a2c5e930d0830a438bc102b8d21482767124f495b92f2ce",
            "2026-01-15_10h28m24.json": "165b171df12b3e8b39504ce36d37e373ad105c0dddf4d3d073c747fd492e8bef",
            "2026-01-15_10h28m32.json": "fdc255edae6995298af437f37582eb8cd0c4a5ddcec4f49fb7c4d6f3303aaa9c",
            "2026-01-15_10h28m42.json": "1c6386bfa3be021c8ca8a96a7cbee93914f6271a050282b1c3b7d5ef373427db",
            "2026-01-15_10h28m57.json": "c10a350d9c7222d4d3499d140edd3ac4e63fe94f3b59a675116a34db7d66152c",
            "2026-01-15_10h29m04.json": "7996c43314a9f60094a6119346b54ff9ff84cb6726c967f4a88a7175278f6515",
            "2026-01-15_10h29m14.json": "016d15d21c464457aa30eaeab3977228b08cd5acf7542f24067440126c0bf480",
            "2026-01-15_10h29m29.json": "b9ce9fc0f396e6b03bd514e9254cb83b8a64e1a5df1728b9a10e3b4a5a9513ca",
            "2026-01-15_10h29m37.json": "838d390b7190c4ce1608157cf629989648773b7336728a0931a61c6018c6700b",
            "2026-01-15_10h29m47.json": "61ae8eeb881be5d8c09f6c7fba4cef39f66b1ff03e0148ef3bc0e314054513f5",
            "2026-01-15_10h30m02.json": "040e065f9885833fa909683f13665f90048ce5457d94dd2a3af056c21c36210d",
            "2026-01-15_10h30m10.json": "01d32db99e7859f012a230aca59f1dda24219d6781472d356861b138526213e6",
        },
        _pendulum,
    ),
}
"""The machines, by name."""
