"""`python -m benchmarks.coverage [--machines N] [--first SEED] [--effects ...] [--demo SEED ...]`: interval coverage.

Machines of `benchmarks.concealed.reality`, fitted from the truth as a diagnosis fits them. Of machines without a hidden
effect: errors of the base model over standard errors, where the descent of the observers ends and of the likeliest
parameters, which are reported. Of machines with a hidden effect whose size means the same in the simulator and here:
errors of that size, of both. Of arms of the demo, diagnosed in full, whose ten elements the named form resembles:
errors over standard errors about that form, and over those that are reported, which include the change of the
parameters by other effects.
"""

import argparse
import importlib
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import frictionjax as fj
from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from benchmarks.diagnosis import SIZES
from frictionjax.core import Estimate, keep_compiled
from frictionjax.demo import write_demo_case
from frictionjax.diagnosis.base_model import fit_base as base_fit
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.intake.starting_point import StartingPoint, starting_point
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive
from frictionjax.physics.effects import catalogue

pipeline = importlib.import_module("frictionjax.diagnosis.diagnose")

INSIDE = 1.96
EFFECTS = [name for name in SIZES if name != "elasto_plastic"]
"""Not elasto-plastic slip: the simulator's bristle yields along another curve."""


def _true_drive(starting: StartingPoint, truth: dict[str, float]) -> Drive:
    names = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    return eqx.tree_at(
        lambda d: (d.J, d.friction),
        starting.start.drives[0],
        (jnp.asarray(truth["J"]), fj.LuGre(*(truth[name] for name in names))),
    )


def _fitted(posterior: Posterior, vector) -> Model:
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    fitted = descend(slow, vector, graduate=False, tolerance=1e-4)
    return Model(slow, fitted, judge(slow, fitted))


def _both(model: Model) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Where the descent ended, and what is reported."""
    return tuple(base_fit.parameters_of(model, {}, lacking=lacking) for lacking in (True, False))  # type: ignore[return-value]


def errors(seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Errors over standard errors of the parameters of one machine: of the descent, as reported."""
    simulated = make_case(seed, missing=(), strength="strong")
    starting, truth = starting_point(case_of(simulated)), simulated.truth["base"]
    model = _fitted(*robust_posterior(_true_drive(starting, truth), starting.batch, starting.held_out))
    descended, reported = (
        {name: (one.value - truth[name]) / one.stderr for name, one in found.items()}
        for found in _both(model)
    )
    return descended, reported


def size_errors(seed: int, effect: str) -> tuple[float, float] | None:
    """Error of the size of an `effect` over its standard error: of the descent, as reported; None where the simulator
    drew a form whose size does not compare."""
    simulated = make_case(seed, missing=(effect,), strength="medium")
    ours, theirs, convert = SIZES[effect]
    drawn = simulated.truth["sizes"][effect]
    if not isinstance(drawn.get(theirs), float) or drawn.get("viscous"):
        return None
    true, starting = convert(drawn[theirs]), starting_point(case_of(simulated))
    drive = _true_drive(starting, simulated.truth["base"])
    form = next(f for f in catalogue()[effect] if ours in [p.name for p in f.strengths + f.nuisances])
    posterior, vector = robust_posterior(drive, starting.batch, starting.held_out)
    posterior, vector = extend(posterior, vector, form(), plant_scales(drive, starting.batch), drive)
    place = next(i for i, free in enumerate(posterior.layout) if free.label == ours)
    free = posterior.layout[place]
    there = np.log(true) if free.parameter.transform == "log" else true / float(free.scale)
    model = _fitted(posterior, jnp.asarray(vector).at[place].set(there))
    descended, reported = ((found[ours].value - true) / found[ours].stderr for found in _both(model))
    return descended, reported


def likeness_errors(seed: int, folder: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Errors of the parameters of the demo's arm over standard errors about the named form, over those reported.

    **Raises:** `ValueError` where something else is named than what the arm hides.
    """
    kept: list[dict[str, Estimate]] = []
    widen = pipeline.moved

    def watched(extended, layout, steps, *, rule):
        kept.append(extended)
        return widen(extended, layout, steps, rule=rule)

    pipeline.moved = watched
    try:
        found = fj.diagnose(fj.load_case(write_demo_case(folder, seed=seed)))
    finally:
        pipeline.moved = widen
    named = [missing.effect for missing in found.missing]
    if named != ["maxwell_slip"]:
        raise ValueError(f"Arm {seed}: {', '.join(named) or 'nothing'} is named, not what it hides.")
    sealed = json.loads(next(folder.rglob("truth.json")).read_text(encoding="utf-8"))
    truth = sealed["base"] | {"share": sealed["maxwell_slip"]["share"]}
    alone, stated = (
        {name: (some[name].value - true) / some[name].stderr for name, true in truth.items()}
        for some in (kept[-1], found.extended)
    )
    return alone, stated


def _each(what: list, label: str) -> Iterator:
    for number, one in enumerate(what, start=1):
        yield one
        sys.stderr.write(f"\r{number} of {len(what)} {label}")
    if what:
        sys.stderr.write("\n")


def _table(title: str, names: list[str], rows: dict[str, list[list[float]]]) -> None:
    sys.stdout.write(f"| {title} | inside 95 % | " + " | ".join(names) + " |\n")
    sys.stdout.write("|---" * (2 + len(names)) + "|\n")
    for words, columns in rows.items():
        every = np.abs(np.concatenate([np.asarray(column) for column in columns]))
        rms = " | ".join(f"{np.sqrt(np.mean(np.square(column))):.2f}" for column in columns)
        sys.stdout.write(f"| {words} | {np.sum(every < INSIDE)} of {every.size} | {rms} |\n")
    sys.stdout.write("\nUnder each name: root mean square of the error over the standard error.\n\n")


def _table_of_pairs(title: str, pairs: list[tuple[dict, dict]], words: tuple[str, str]) -> None:
    """Nothing where there are no pairs."""
    if pairs:
        names = list(pairs[0][0])
        rows = {w: [[pair[place][name] for pair in pairs] for name in names] for place, w in enumerate(words)}
        _table(title, names, rows)


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=8)
    parser.add_argument("--first", type=int, default=1300)
    parser.add_argument("--effects", nargs="*", default=EFFECTS, choices=EFFECTS)
    parser.add_argument("--demo", type=int, nargs="*", default=[], help="seeds of the demo's arm")
    arguments = parser.parse_args()
    fj.configure_jax()
    keep_compiled()
    seeds = list(range(arguments.first, arguments.first + arguments.machines))
    pairs = [errors(seed) for seed in _each(seeds, "machines that hide nothing")]
    _table_of_pairs("parameters", pairs, ("of the descent", "as reported"))
    found: dict[str, list[tuple[float, float]]] = {}
    for effect, seed in _each([(e, s) for e in arguments.effects for s in seeds], "machines that hide one"):
        jax.clear_caches()  # programs are of the machine's lengths: kept, they would fill the memory
        pair = size_errors(seed, effect)
        if pair is not None:
            found.setdefault(effect, []).append(pair)
    if found:
        rows = {
            w: [[pair[place] for pair in some] for some in found.values()]
            for place, w in enumerate(("of the descent", "as reported"))
        }
        _table("standard errors", list(found), rows)
    with tempfile.TemporaryDirectory() as folder:
        pairs = [likeness_errors(seed, Path(folder, str(seed))) for seed in _each(arguments.demo, "arms")]
    _table_of_pairs("standard errors", pairs, ("about the named form", "as reported"))


if __name__ == "__main__":
    main()
