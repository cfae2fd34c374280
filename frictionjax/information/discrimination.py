"""`rank_for_discrimination`: which experiment discriminates best between two models, the rival refitted.

A difference between two models does not count where other parameter values of the rival reproduce it. What remains
after the refit, over the noise, is their distance d'.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np
import scipy

from frictionjax.core import InputError, require_x64
from frictionjax.core.progress import Progress, reporting
from frictionjax.information.candidate_experiments import (
    CandidateInputs,
    Rejected,
    broken_limits,
    candidates_of,
    limits_of,
)
from frictionjax.information.planned import Numbers, plan_of, values_of
from frictionjax.information.refitting import Distance, Rival, distance, finite_or_error
from frictionjax.information.rivals import base_and, free_of, named_pair
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect

LEVEL = 0.05
"""Probability of rejecting a model that is true, in the test whose power is `Discriminator.probability`."""
_ALWAYS_FITS = Distance(np.inf, np.inf, True)  # with the base model as truth, its rival always fits


class Discriminator(eqx.Module):
    """A candidate experiment and how well it discriminates between the two models.

    **Attributes:**

    - `name`: of the candidate.
    - `d_prime`: least distance of the two models in standard deviations of the noise, after the refit: the smaller of
        the next two.
    - `first_true`, `second_true`: d' when the first (second) model is true and the other refitted; `inf` where the
        base model is true: a model with an effect always fits its data.
    - `one_step`: the smaller of the two by the linear projection alone.
    - `converged`: whether, in the direction that counts, no further step of the refit promises to lower d'^2 by more
        than 2 %; else `d_prime` is an upper bound, or for `refit_steps = 0` that of the linear projection.
    - `probability`: that a two-sided test at the level of 5 % rejects the wrong model.
    - `sentence`: the same in words.
    """

    name: str = eqx.field(static=True)
    d_prime: float = eqx.field(static=True)
    first_true: float = eqx.field(static=True)
    second_true: float = eqx.field(static=True)
    one_step: float = eqx.field(static=True)
    converged: bool = eqx.field(static=True)
    probability: float = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


class Discrimination(eqx.Module):
    """Candidate experiments, the one that discriminates best first.

    **Attributes:**

    - `models`: names of the two models.
    - `entries`: a `Discriminator` for each candidate that is allowed, the largest d' first.
    - `rejected`: a `Rejected` for each candidate that exceeds a limit under either model.
    """

    models: tuple[str, str] = eqx.field(static=True)
    entries: tuple[Discriminator, ...]
    rejected: tuple[Rejected, ...]

    @property
    def best(self) -> Discriminator:
        """The entry of the largest d'."""
        return self.entries[0]


def rank_for_discrimination(
    drive: Drive,
    first: AbstractEffect | None,
    second: AbstractEffect | None,
    candidates: Mapping[str, CandidateInputs],
    sample_rate: Numbers,
    noise: Numbers,
    *,
    free: Sequence[str] | None = None,
    limits: Mapping[str, float] | None = None,
    refit_steps: int = 10,
    x0: Numbers = 0.0,
    v0: Numbers = 0.0,
    z0: Numbers | None = None,
    substeps: int = 2,
    progress: Progress | bool = True,
) -> Discrimination:
    """Rank candidate experiments by how well they discriminate between `first` and `second` as what `drive` leaves out.

    T-optimality (Atkinson and Fedorov, Biometrika 62, 1975): with x1 the positions of the true model, x2(q) those of
    its rival, S2 = dx2/dq and P the projector off the span of S2 (less a weak prior of three times the size of each q),

        d'^2 = min over q of ||x1 - x2(q)||^2 / noise^2,    in one step:   ||P (x1 - x2(0))||^2 / noise^2

    and the smaller d' of the two directions counts (1 true and 2 refitted; 2 true and 1 refitted). The projection is
    linear: it is one step of Gauss and Newton from the guess, and wrong where the rival's parameters move far. At most
    `refit_steps` steps, each simulated anew, and shortened or damped (Levenberg and Marquardt) until it fits better,
    correct for that; d' is then what the last simulation leaves. The refit starts with the rival's strengths as given
    or with none, whichever fits better, and with the other if that does not converge.

    The rival's free parameters are those of the base model and its own strengths; its nuisances (periods, times) stay,
    unless `free` names them.

    Candidates of the same length share one compiled program for each model; other numbers compile nothing anew.

    **Arguments:**

    - `drive`: the `Drive` without either effect, with the parameter values that are expected.
    - `first`, `second`: the effects, each with strengths of a typical size; None: the `drive` as it is. Against
        that, only the direction in which the effect is true counts: with a strength of zero it is the base model.
    - `candidates`: name -> input of shape `(n,)`, input units, or a list of inputs that are recorded one after the
        other and refitted together.
    - `sample_rate`: samples per second; one number, or one for each record, counted through all candidates.
    - `noise`: standard deviation of the white noise of the measured position, position units; likewise.
    - `free`: names of unknown parameters of either model, beside the rival's strengths; None: J, the six of LuGre and
        strengths that `drive` has.
    - `limits`: largest magnitudes that the machine allows, as in `rank_experiments`, under either model.
    - `refit_steps`: steps of the refit at most; it stops when it has converged. 0: the linear projection alone.
    - `x0`, `v0`: known position and velocity at each start, position units and position/s; likewise.
    - `z0`: known bristle deflection at each start, position units; None: as in `fisher_information`.
    - `substeps`: steps per sample, see `simulate`.
    - `progress`: called after each candidate; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    A `Discrimination`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` as in `rank_experiments`, when the two effects are the
    same but for their strengths, one has no strength, or a run overflows.
    """
    require_x64()
    names, (choice, allowed) = named_pair(first, second), (candidates_of(candidates), limits_of(limits))
    if refit_steps < 0:
        raise InputError(f"it is {refit_steps}", place="`refit_steps`", cure="Give 0 or more.")
    start = {"x0": x0, "v0": v0, "z0": z0, "substeps": substeps}
    plan = plan_of(choice.inputs, sample_rate, noise, labels=choice.labels, **start)
    layouts = free_of(drive, first, second, free)
    models = [
        Rival(base_and(drive, one), layout) for one, layout in zip((first, second), layouts, strict=True)
    ]
    for model in models:
        values_of(model.layout, model.drive)
    entries, rejected = [], []
    with reporting(progress) as report:
        for done, (name, group) in enumerate(zip(choice.names, choice.groups, strict=True)):
            session = plan.of(group)
            runs = [model.run(session) for model in models]
            peaks = {key: float(np.max([run.peaks[key] for run in runs])) for key in ("x", "v")}
            peaks["u"] = max(float(np.max(np.abs(u))) for u in session.inputs)
            broken = broken_limits(name, peaks, allowed)
            if broken is not None:
                rejected.append(broken)
            else:
                for run in runs:
                    finite_or_error(run, session)
                place, ways = len(drive.effects), []
                for effect, truth, rival, own in zip(
                    (first, second), runs, models[::-1], runs[::-1], strict=True
                ):
                    way = (
                        distance(rival, own, truth, session, place, refit_steps)
                        if effect is not None
                        else _ALWAYS_FITS
                    )
                    ways.append(way)
                entries.append(_entry(name, ways, names, refit_steps))
            report(f"refits of candidate {name!r}", (done + 1) / len(choice.names))
    if not entries:
        raise InputError(
            " ".join(one.sentence for one in rejected),
            place="`limits`",
            cure="Give a weaker candidate, or a wider limit.",
        )
    entries.sort(key=lambda one: -one.d_prime)
    return Discrimination(names, tuple(entries), tuple(rejected))


def _entry(name: str, ways: list[Distance], models: tuple[str, str], steps: int) -> Discriminator:
    d = min(way.refitted for way in ways)
    z = scipy.stats.norm.ppf(1.0 - LEVEL / 2.0)
    probability = float(scipy.stats.norm.cdf(d - z) + scipy.stats.norm.cdf(-d - z))
    converged = min(ways, key=lambda way: way.refitted).converged
    verdict = f"distinguishes {models[0]} from {models[1]} with a probability of {100.0 * probability:.3g} %"
    doubt = ", an upper bound: the refit has not converged" if steps else " by the linear projection"
    return Discriminator(
        name,
        float(d),
        float(ways[0].refitted),
        float(ways[1].refitted),
        float(min(way.one_step for way in ways)),
        converged,
        probability,
        f"{name} {verdict}: d' = {d:.3g}{'' if converged else doubt}.",
    )
