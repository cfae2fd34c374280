"""`optimise_multisine`: how a multisine should distribute its power over its lines, and with which phases.

The sensitivities S = dx/dq are made in forward mode (few parameters, many samples); the derivative of the criterion by
the lines is taken backwards through them, in one pass however many lines there are: forward mode would need a run
for each line and each parameter.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, ArrayLike, Bool, Float, Real

from frictionjax.core import InputError, require_x64
from frictionjax.core.progress import Progress, reporting
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import Free
from frictionjax.information.criteria import (
    Criterion,
    Kind,
    Question,
    bounds_in_words,
    known_rows,
    question_of,
)
from frictionjax.information.fisher import Information, assembled, planned_records, sensitivities
from frictionjax.information.planned import Plan, Signal, Start, layout_of, plan_of, values_of
from frictionjax.information.signal_shape import SignalShape, lines_of, size_of
from frictionjax.physics import Drive

_WIDEST = np.log(1e3)  # how far the logarithm of an amplitude may go from its start
_NO_GO = 1e6  # loss of an input whose run overflows: the line search steps back from it


class DesignedMultisine(eqx.Module):
    """A multisine and its information, before and after its lines were optimised.

    **Attributes:**

    - `u`: the input, shape `(n,)`, input units, one period.
    - `frequency`: of its `m` lines, Hz, shape `(m,)`.
    - `amplitudes`, `phases`: u = sum of amplitude * cos(2 pi frequency t + phase), input units and rad, shape `(m,)`.
    - `before`, `after`: gain over what is known, as `RankedExperiment.gain`, of the start and of `u`.
    - `history`: the gain after each step, the start first, shape `(k,)`.
    - `std_before`, `std_after`: name -> least standard deviation with what is known, as in `Information.std`.
    - `information`: `Information` of `u` alone.
    - `peaks`: largest |x| (position units), |v| (position/s) and |u| (input units) of a run with `u`.
    - `sentence`: the same in words.
    """

    u: Float[np.ndarray, " n"]
    frequency: Float[np.ndarray, " m"]
    amplitudes: Float[np.ndarray, " m"]
    phases: Float[np.ndarray, " m"]
    before: float
    after: float
    history: Float[np.ndarray, " k"]
    std_before: dict[str, float] = eqx.field(static=True)
    std_after: dict[str, float] = eqx.field(static=True)
    information: Information
    peaks: dict[str, float] = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


def optimise_multisine(
    drive: Drive,
    start: Signal,
    sample_rate: Real[ArrayLike, ""],
    noise: Real[ArrayLike, ""],
    *,
    criterion: Kind = "D",
    of: str | Sequence[str] | None = None,
    known: Information | None = None,
    free: Sequence[str] | None = None,
    rms: float | int | None = None,
    peak: float | int | None = None,
    optimise_phases: bool = False,
    steps: int = 20,
    x0: Real[ArrayLike, ""] = 0.0,
    v0: Real[ArrayLike, ""] = 0.0,
    z0: Real[ArrayLike, ""] | None = None,
    substeps: int = 2,
    progress: Progress | bool = True,
) -> DesignedMultisine:
    """Optimise the amplitudes of a multisine, at constant power, for its information about the parameters of `drive`.

    Maximises the criterion of `rank_experiments` over the logarithms of the amplitudes a of the lines that `start` has,
    and over their phases if wanted, by L-BFGS-B (Byrd, Lu, Nocedal and Zhu 1995) with the gradient by automatic
    differentiation through the simulation. The signal is scaled for each a to constant rms (or peak):

        u = rms w / rms(w),    w = sum over lines of exp(theta_l) cos(2 pi f_l t + phi_l)

    It finds a local optimum, and one for the parameters that `drive` has: a guess that is off by the bounds before the
    experiment may change which input is best. With `peak` the criterion has kinks where another sample becomes the
    largest. Starts of one length and number of lines share one compiled program, which takes about ten seconds to make.

    **Arguments:**

    - `drive`: the `Drive`, with the parameter values that are expected.
    - `start`: the multisine to start from, one period, shape `(n,)`, n at most 16384, input units; made by `multisine`.
        Only lines that it has are used.
    - `sample_rate`: samples per second.
    - `noise`: standard deviation of the white noise of the measured position, position units.
    - `criterion`, `of`, `known`, `free`: as in `rank_experiments`.
    - `rms`: root mean square of the input, input units; None: that of `start`.
    - `peak`: largest magnitude of the input, input units, kept constant in place of the rms.
    - `optimise_phases`: whether the phases are moved too, once the amplitudes alone have been.
    - `steps`: iterations at most, of the amplitudes and once more with the phases.
    - `x0`, `v0`: known position and velocity at the start, position units and position/s.
    - `z0`: known bristle deflection at the start, position units; None: as in `fisher_information`.
    - `substeps`: steps per sample, see `simulate`.
    - `progress`: called after each step; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    A `DesignedMultisine`; that of the start when nothing better is found.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` as in `rank_experiments`, and when `start` has a mean,
    a line at half of `sample_rate`, only one line whose phase is fixed, or more than 16384 samples, when both `rms` and
    `peak` are given or one is not positive, or when the run of `start` overflows.
    """
    require_x64()
    plan = plan_of([start], sample_rate, noise, x0=x0, v0=v0, z0=z0, substeps=substeps, labels=["`start`"])
    lines, amplitude, phase = lines_of(plan.inputs[0])
    size = size_of(plan.inputs[0], rms, peak)
    if steps < 1:
        raise InputError(f"it is {steps}", place="`steps`", cure="Give at least one.")
    if len(lines) < 2 and not optimise_phases:
        raise InputError(
            "with one line there is nothing to optimise at a given power",
            place="`start`",
            cure="Give more lines, or set `optimise_phases`.",
        )
    layout = layout_of(drive, known.names if free is None and known is not None else free)
    names = tuple(one.label for one in layout)
    before = known_rows(known, names, values_of(layout, drive))
    question = question_of(criterion, of, names)
    first = np.concatenate([np.log(amplitude), phase])
    shape = SignalShape(
        real(np.zeros(plan.inputs[0].size)), jnp.asarray(lines), real(size), jnp.asarray(peak is not None)
    )
    plan = _with_input(plan, shape.signal(real(first)))
    records = [next(planned_records(layout, drive, plan))]
    found = assembled(layout, drive, plan, records)
    scale = found.scale if known is None else known.scale
    judge = question.criterion(names, scale)
    problem = _DesignProblem(
        drive, 1.0 / real(plan.rates[0]), real(plan.noises[0]), plan.starts[0], real(before)
    )

    def value_and_slope(theta: Float[np.ndarray, " t"]) -> tuple[float, Float[np.ndarray, " t"]]:
        value, slope = _value_and_slope(layout, judge, shape, plan.substeps, problem, real(theta))
        return float(value), np.array(slope)

    stages = [np.arange(first.size) < len(lines)] + [np.ones(first.size, bool)] * optimise_phases
    with reporting(progress) as report:
        report("multisine: compiling", 0.0)
        theta, history = _climbed(value_and_slope, first, stages, steps, criterion == "A", report)
    return _designed(
        layout, drive, plan, shape, found, known, scale, theta, history - float(judge(before)), question
    )


def _climbed(
    value_and_slope: Callable[[Float[np.ndarray, " t"]], tuple[float, Float[np.ndarray, " t"]]],
    first: Float[np.ndarray, " t"],
    stages: Sequence[Bool[np.ndarray, " t"]],
    steps: int,
    logarithm: bool,
    progress: Progress,
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " k"]]:
    """The best theta, and the value after each step, the start first, of `steps` in each of the `stages`: which entries
    of theta move. With `logarithm` what is climbed is -log(-value)."""
    best: list[Any] = [np.inf, first, np.nan]
    history: list[float] = []

    def loss(
        theta: Float[np.ndarray, " t"], moving: Bool[np.ndarray, " t"]
    ) -> tuple[float, Float[np.ndarray, " t"]]:
        value, slope = value_and_slope(theta)
        if not np.isfinite(value) or not np.all(np.isfinite(slope)):
            return _NO_GO, np.zeros_like(slope)
        # Variances of parameters that are known well are tiny; their logarithm has the same optimum and a usable slope.
        lost, slope = (0.5 * np.log(-value), 0.5 * slope / value) if logarithm else (-value, -slope)
        if lost < best[0]:
            best[:] = [lost, np.array(theta), value]
        return lost, np.where(moving, slope, 0.0)

    def record(theta: Float[np.ndarray, " t"]) -> None:
        history.append(best[2])
        done, every = len(history) - 1, steps * len(stages)
        progress(f"multisine: step {done} of {every}", done / every)

    loss(first, stages[0])
    if not np.isfinite(best[0]):
        raise InputError(
            "the derivative by its lines is not finite",
            place="`start`",
            cure="Raise `sample_rate` or `substeps`.",
        )
    record(first)
    reach = np.where(stages[0], _WIDEST, np.inf)
    bounds = np.stack([first - reach, first + reach], axis=1)
    for moving in stages:
        options = {"maxiter": steps}
        scipy.optimize.minimize(
            loss, best[1], moving, "L-BFGS-B", jac=True, bounds=bounds, callback=record, options=options
        )
        if best[2] != history[-1]:
            # A last, abandoned line search may have found a better point, which is `best`.
            history.append(best[2])
    return best[1], np.asarray(history)


class _DesignProblem(NamedTuple):
    """The numbers of a case; `known` are the rows of the information known before."""

    drive: Drive
    dt: Float[Array, ""]
    noise: Float[Array, ""]
    start: Start
    known: Float[Array, "p p"]


@eqx.filter_jit
def _value_and_slope(
    layout: tuple[Free, ...],
    judge: Criterion,
    shape: SignalShape,
    substeps: int,
    problem: _DesignProblem,
    theta: Float[Array, " t"],
) -> tuple[Float[Array, ""], Float[Array, " t"]]:
    def value(theta: Float[Array, " t"]) -> Float[Array, ""]:
        u = shape.signal(theta)
        _, _, columns = sensitivities(layout, problem.drive, u, problem.dt, problem.start, substeps)
        return judge(jnp.concatenate([columns.T / problem.noise, problem.known]))

    return jax.value_and_grad(value)(theta)


def _with_input(plan: Plan, u: Float[Array | np.ndarray, " n"]) -> Plan:
    return eqx.tree_at(lambda p: p.inputs, plan, [np.asarray(u)])


def _designed(
    layout: tuple[Free, ...],
    drive: Drive,
    plan: Plan,
    shape: SignalShape,
    before: Information,
    known: Information | None,
    scale: Float[np.ndarray, " p"],
    theta: Float[np.ndarray, " t"],
    history: Float[np.ndarray, " k"],
    question: Question,
) -> DesignedMultisine:
    amplitudes, u = (np.asarray(part) for part in shape.scaled(real(theta)))
    plan = _with_input(plan, u)
    record = next(planned_records(layout, drive, plan))
    alone = [before, assembled(layout, drive, plan, [record])]
    # One size of a strength throughout: that of the criterion.
    alone = [eqx.tree_at(lambda i: i.scale, one, scale) for one in alone]
    both = [one if known is None else known + one for one in alone]
    sentence = f"The multisine {question.in_words(history[-1], both[1].names)}, its start {history[0]:.3g}"
    return DesignedMultisine(
        u=u,
        frequency=np.asarray(shape.lines) * plan.rates[0] / u.size,
        amplitudes=amplitudes,
        phases=np.angle(np.exp(1j * theta[len(amplitudes) :])),
        before=float(history[0]),
        after=float(history[-1]),
        history=history,
        std_before=both[0].std,
        std_after=both[1].std,
        information=alone[1],
        peaks={"x": record.peak_x, "v": record.peak_v, "u": float(np.max(np.abs(u)))},
        sentence=f"{sentence}; {bounds_in_words(both[1], question.of)}.",
    )
