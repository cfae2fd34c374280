"""`python -m benchmarks.coverage [--machines N] [--first SEED]`: how often intervals of the diagnosis hold the truth.

Machines of `benchmarks.concealed.reality` that hide nothing, fitted from the truth as a diagnosis fits its base model:
errors over standard errors, with one integration step a sample and with the finer steps that are reported.
"""

import argparse
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import frictionjax as fj
from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from frictionjax.diagnosis import base_fit
from frictionjax.diagnosis.begin import begin
from frictionjax.diagnosis.judge import judge
from frictionjax.diagnosis.refit import Model
from frictionjax.estimation.joint import SLOW_BANDWIDTH, make_joint
from frictionjax.estimation.parameters import physical
from frictionjax.estimation.robust_fit import descend

INSIDE = 1.96


def errors(seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Errors over standard errors of the parameters of one machine: one step a sample, finer steps."""
    simulated = make_case(seed, missing=(), strength="strong")
    begun, truth = begin(case_of(simulated)), simulated.truth["base"]
    names = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    drive = eqx.tree_at(
        lambda d: (d.J, d.friction),
        begun.start.drives[0],
        (jnp.asarray(truth["J"]), fj.LuGre(*(truth[name] for name in names))),
    )
    joint, vector = make_joint(drive, begun.batch, begun.held_out)
    slow = joint.at_bandwidth(SLOW_BANDWIDTH)
    fitted = descend(slow, vector, graduate=False, tolerance=1e-4)
    found = base_fit.parameters_of(Model(slow, fitted, judge(slow, fitted)), {})
    count = len(slow.layout)
    coarse, _ = physical(slow.layout, slow.setting.drive, fitted.vector[:count], slow.setting.start[:count])
    one = {
        name: (float(value) - truth[name]) / e.stderr
        for (name, e), value in zip(found.items(), coarse, strict=True)
    }
    return one, {name: (e.value - truth[name]) / e.stderr for name, e in found.items()}


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=8)
    parser.add_argument("--first", type=int, default=1300)
    arguments = parser.parse_args()
    fj.configure_jax()
    seeds = range(arguments.first, arguments.first + arguments.machines)
    pairs = []
    for number, seed in enumerate(seeds, start=1):
        pairs.append(errors(seed))
        sys.stderr.write(f"\r{number} of {len(seeds)} machines")
    sys.stderr.write("\n")
    sys.stdout.write("| steps a sample | inside 95 % | " + " | ".join(pairs[0][0]) + " |\n")
    sys.stdout.write("|---" * (2 + len(pairs[0][0])) + "|\n")
    for words, place in (("one", 0), ("four", 1)):
        table = np.array([list(pair[place].values()) for pair in pairs])
        rms = " | ".join(f"{value:.2f}" for value in np.sqrt(np.mean(table**2, axis=0)))
        sys.stdout.write(f"| {words} | {np.sum(np.abs(table) < INSIDE)} of {table.size} | {rms} |\n")
    sys.stdout.write("\nUnder each parameter: root mean square of its error over its standard error.\n")


if __name__ == "__main__":
    main()
