"""`python -m benchmarks.real_machines [NAME ...]`: what `diagnose` says of published recordings, a row for each.

Recordings are looked for where the environment variable FRICTIONJAX_DATA says; what is absent is named on stderr.
"""

import sys
import warnings

import numpy as np
from scipy.io import loadmat

import frictionjax as fj
from frictionjax.studies.real_machines import MACHINES, files_of, load_machine, load_speed_error


def row(name: str, found) -> str:
    """One machine as a row of the table."""
    named = "; ".join(
        f"{m.effect} ("
        + ", ".join(f"{k} {e.value:.3g} ± {e.stderr:.1g}" for k, e in m.parameters.items())
        + ")"
        for m in found.missing
    )
    ahead, free = (
        " → ".join(f"{error:.3g}" for error in found.held_out_rmse(kind))
        for kind in ("prediction", "free_run")
    )
    imposed = found.recordings[0].drive == "motion"
    unit = found.plant.force_unit if imposed else found.plant.position_unit
    left = f"{100 * found.unexplained.share:.0f} %" if found.unexplained.present else "nothing"
    return (
        f"| {name} | {found.verdict} | {named or 'nothing'} | {ahead} | {free} | {unit} | {left} | "
        f"{found.seconds['total']:.0f} ({found.seconds['compile']:.0f}) |"
    )


def load_speed(found) -> str:
    """How well the spring that was found predicts the load's speed, which no fit uses."""
    frequency, *lost = (found.extended[name].value for name in ("frequency", "damping", "drag"))
    said = []
    for name, path in files_of("motor_bench").items():
        file = loadmat(path)
        motor, load = (np.ravel(file[channel]) for channel in ("omega_max", "omega_may"))
        spring, rigid = (load_speed_error(motor, load, f, *lost) for f in (frequency, np.inf))
        said.append(f"{name}: {100 * spring:.1f} % (stiff shaft: {100 * rigid:.0f} %)")
    return "Load speed of the motor bench missed by " + ", ".join(said)


def offset_drift(found) -> str:
    """How far the mean of the motor bench's current carries the models in a free run, if nothing else is wrong.

    Gaussian velocity of root mean square s about a slow drift turns Coulomb friction into viscous friction
    sqrt(2/pi) Fc/s; the drift is the mean current over all viscous friction, and from rest its error is a ramp.
    """
    models = [{name: one.value for name, one in model.items()} for model in (found.base, found.extended)]
    said = []
    for run in found.recordings:
        seconds, spread = run.t[-1] - run.t[0], np.std(np.gradient(run.x, run.t))
        own = [
            p["sigma2"]
            + p["J"] * p.get("ratio", 0.0) * p.get("drag", 0.0)
            + np.sqrt(2.0 / np.pi) * p["Fc"] / spread
            for p in models
        ]
        base, extended = (abs(np.mean(run.u)) / one * seconds / np.sqrt(3.0) for one in own)
        said.append(
            f"{run.name}: mean {np.mean(run.u):.3f} A, {base:.2f} and {extended:.1f} rad "
            f"(free run: {run.free_run_rmse_base:.2f} and {run.free_run_rmse_extended:.1f})"
        )
    return "Drift that the mean current of the motor bench would cause, base and extended: " + "; ".join(said)


def main() -> int:
    """Print the table."""
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    fj.configure_jax()
    sys.stdout.write(
        "| machine | verdict | named | held-out error 0.1 s ahead, base → extended | free run | unit | "
        "misfit left | s (compile, all threads) |\n|---|---|---|---|---|---|---|---|\n"
    )
    notes = []
    for name in sys.argv[1:] or list(MACHINES):
        try:
            case = load_machine(name)
        except fj.InputError as absent:
            sys.stderr.write(f"{name}: left out. {absent}\n")
            continue
        found = fj.diagnose(case)
        sys.stdout.write(row(name, found) + "\n")
        sys.stdout.flush()
        if name == "motor_bench" and found.missing and found.missing[0].effect == "flexible_transmission":
            notes += [load_speed(found), offset_drift(found)]
    sys.stdout.write("".join(f"\n{note}\n" for note in notes))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
