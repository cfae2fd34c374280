"""Name: every effect tested against the base fit, with all base parameters free to absorb it.

For each form of each effect, finite steps of its strength are simulated; the innovations are regressed on them and
on the Jacobian of the present model. The one-step estimate is then simulated: what the misfit really gains ranks
the candidates (a linear gain can be a mirage), and the clustered score test gives the p-value.
"""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import f

from frictionjax.estimation.problem import Problem, extend_problem
from frictionjax.estimation.residuals import block_power, weights
from frictionjax.estimation.uncertainty import cluster_gradients
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect

_DAMPING = (1.0, 0.4)
_LONGEST_STEP = 1.5


class Trial(eqx.Module):
    """One effect form tested at one value of its nuisances.

    **Attributes:** `effect` (name), `drive` (the present model with the effect in place, still at zero strength),
    `problem`, `vector` (the best one-step vector), `gain` (drop of the misfit when that vector is simulated),
    `linear_gain` (drop promised by the regression), `p_value` (clustered score test), `one_step` and `detectable`
    (strength name -> one-step estimate, smallest detectable size, in the strength's unit).
    """

    effect: str = eqx.field(static=True)
    drive: Drive
    problem: Problem
    vector: Float[Array, " q"]
    gain: float
    linear_gain: float
    p_value: float
    one_step: dict[str, float] = eqx.field(static=True)
    detectable: dict[str, float] = eqx.field(static=True)


class Present(eqx.Module):
    """The model to which effects are added.

    **Attributes:** `problem` and `vector` (fitted), `e` (innovations, shape `(r, n)`), `jacobian` (`(q, r, n)`),
    `misfit`.
    """

    problem: Problem
    vector: Float[Array, " q"]
    e: Float[Array, "r n"]
    jacobian: Float[Array, "q r n"]
    misfit: float


def forms_to_try(
    forms: tuple[type[AbstractEffect], ...], scales: dict[str, float], periods: dict[str, tuple[float, ...]]
) -> list[AbstractEffect]:
    """Instances at zero strength, one for every form and grid point of its nuisances.

    **Arguments:**

    - `forms`: classes that share a name.
    - `scales`: the plant's sizes.
    - `periods`: `"odd_period"` and `"even_period"` -> periods found in the data.
    """
    instances = []
    for form in forms:
        axes = []
        for nuisance in form.nuisances:
            if nuisance.grid == "period":
                axes.append([(nuisance.name, period) for period in periods[str(nuisance.scale)]])
            else:
                scale = nuisance.scale if isinstance(nuisance.scale, float) else scales[str(nuisance.scale)]
                axes.append([(nuisance.name, scale * value) for value in nuisance.grid])
        instances += [form(**dict(point)) for point in itertools.product(*axes)]
    return instances


@eqx.filter_jit
def _regress(e, base, columns, weight, prior, setting):
    """Normal equations of the innovations on [base, columns], and cluster gradients of the projected columns."""
    design = jnp.concatenate([base, columns])
    weighted = design * weight[None]
    gram = jnp.einsum("irn,jrn->ij", weighted, design)
    right = jnp.einsum("irn,rn->i", weighted, e)
    count = base.shape[0]
    own = gram[:count, :count] + jnp.diag(prior**2)
    coefficients = jnp.linalg.solve(own, gram[:count, count:])
    projected = columns - jnp.einsum("ij,irn->jrn", coefficients, base)
    setting = eqx.tree_at(lambda s: s.weight, setting, weight)
    return gram, right, cluster_gradients(e, projected, setting)


def try_effect(present: Present, instance: AbstractEffect, scales: dict[str, float]) -> list[Trial]:
    """Test one `instance` (an effect at zero strength) against the `present` model.

    **Arguments:**

    - `present`: the fitted model.
    - `instance`: the effect.
    - `scales`: the plant's sizes.

    **Returns:**

    One `Trial` per set of finite steps (a strength with several probe sizes gives several).
    """
    extended, vector, drive = extend_problem(present.problem, present.vector, instance, scales)
    setting = extended.setting
    count, old = len(extended.layout), len(present.problem.layout)

    # A parameter of the present model sits at the same place; those of the new effect follow it.
    names = [strength.name for strength in instance.strengths]
    where = [i for i in range(old, count) if extended.layout[i].parameter.name in names]
    strengths = [extended.layout[i].parameter for i in where]
    probes = (
        [[(where[0], size)] for size in strengths[0].probes]
        if len(where) == 1
        else [[(i, p.probes[0]) for i, p in zip(where, strengths, strict=True)]]
    )
    stepped = [vector.at[i].add(size) for probe in probes for i, size in probe]
    sizes = jnp.asarray([size for probe in probes for _, size in probe])
    columns = (extended.errors(*stepped) - present.e[None]) / sizes[:, None, None]

    trials, first = [], 0
    power = block_power(present.e, setting.batch)
    scored = np.asarray(setting.batch.block_count) > 0
    knees = (1.0, max(float(np.quantile(np.asarray(power)[scored], 0.7)), 1.0))
    for probe in probes:
        here = columns[first : first + len(probe)]
        first += len(probe)
        # A step through a break-away event can throw the trajectory: such a column says nothing about a small effect.
        if not bool(jnp.all(jnp.isfinite(here))):
            continue
        trials.append(
            _one_step(present, instance, extended, vector, [i for i, _ in probe], here, power, knees, drive)
        )
    return trials


def _one_step(present, instance, extended, vector, where, columns, power, knees, drive) -> Trial:
    setting = extended.setting
    old, count = len(present.problem.layout), len(extended.layout)
    recordings = vector.shape[0] - count
    prior = present.problem.setting.prior
    # Present parameters (the first `old`), bristle deflections, then the strengths under test.
    position = np.concatenate([np.arange(old), np.arange(count, count + recordings), np.asarray(where)])
    candidates, linear, p_value = [vector], 0.0, 1.0
    spread = np.full(len(where), np.inf)
    for knee in dict.fromkeys(knees):
        weight = weights(power, jnp.sqrt(jnp.asarray(knee)), setting.batch)
        gram, right, gradients = (
            np.asarray(a) for a in _regress(present.e, present.jacobian, columns, weight, prior, setting)
        )
        ridge = np.concatenate([np.asarray(prior) ** 2, np.full(len(where), 1e-12)])
        base = old + recordings
        step = -np.linalg.lstsq(gram + np.diag(ridge), right, rcond=None)[0]
        without = -np.linalg.lstsq(gram[:base, :base] + np.diag(ridge[:base]), right[:base], rcond=None)[0]
        linear = max(linear, float(-(right @ step) + right[:base] @ without) / float(np.sum(weight > 0)))
        for damping in _DAMPING:
            change = np.zeros(vector.shape[0])
            change[position] = damping * np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            candidates.append(vector + jnp.asarray(change))
        if knee == knees[0]:
            p_value = _score_test(gradients)
            if len(where) == 1 and extended.layout[where[0]].parameter.lower == 0.0:
                # A strength that cannot be negative is tested on its own side.
                p_value = 0.5 * p_value if step[-1] > 0.0 else 1.0 - 0.5 * p_value
            information = np.linalg.inv(gram + np.diag(ridge))[base:, base:]
            outer = gradients.T @ gradients
            spread = np.sqrt(np.diag(information @ outer @ information))
    values = extended.misfits(*candidates)
    best = int(np.argmin(values))
    free = [extended.layout[i] for i in where]
    return Trial(
        effect=instance.name,
        drive=drive,
        problem=extended,
        vector=candidates[best],
        gain=present.misfit - float(values[best]),
        linear_gain=linear,
        p_value=p_value,
        one_step={
            p.parameter.name: float(
                np.clip(candidates[best][i] * p.scale, p.parameter.lower, p.parameter.upper)
            )
            for p, i in zip(free, where, strict=True)
        },
        detectable={p.parameter.name: float(4.0 * s * p.scale) for p, s in zip(free, spread, strict=True)},
    )


def _score_test(gradients: np.ndarray) -> float:
    """p-value of "all strengths are zero" from cluster gradients, shape `(c, k)`: Hotelling's T^2 of their mean, robust
    to what correlates inside a cluster (0.5 s)."""
    used = gradients[np.any(gradients != 0.0, axis=1)]
    clusters, count = used.shape
    if clusters <= count + 1:
        return 1.0
    mean = used.mean(axis=0)
    covariance = np.atleast_2d(np.cov(used, rowvar=False))
    statistic = clusters * float(mean @ np.linalg.lstsq(covariance, mean, rcond=None)[0])
    return float(f.sf(statistic * (clusters - count) / (count * (clusters - 1)), count, clusters - count))
