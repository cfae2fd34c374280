"""The second-order system of the paper's (6), sampled, and the iteration that fits it to a frequency response.

Everything here is scaled: frequencies by the upper end of the band, responses by the largest in it, so that the
coefficients `a = (a0, a1, a2, delay)` of `1 / (a0 + a1 s + a2 s^2)` are of the order of one on any machine.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

IMAGES = 16
SHORTENINGS = 2.0 ** -np.arange(12.0)


class Lines(NamedTuple):
    """The bins that are fitted.

    **Attributes:**

    - `omega`: angular frequency, shape `(n,)`.
    - `response`: what was measured there, shape `(n,)`.
    - `weight`: one over the standard deviation of its real and of its imaginary part; zero for padding, shape `(n,)`.
    - `sample_omega`: angular sample rate, shape `()`.
    """

    omega: Float[Array, " n"]
    response: Complex[Array, " n"]
    weight: Float[Array, " n"]
    sample_omega: Float[Array, ""]


class Iteration(NamedTuple):
    """The state of an iteration.

    **Attributes:**

    - `a`: coefficients, shape `(4,)`.
    - `cost`: sum of squares of the weighted residuals, shape `()`.
    - `history`: root of the cost after each step, the start first, NaN where no step was made, `(max_steps + 1,)`.
    - `steps`: how many steps were made, shape `()`.
    - `stopped`: whether no step lowers the cost any more, shape `()`.
    - `converged`: whether it stopped because the last proposal was within a fraction of the standard errors.
    """

    a: Float[Array, " 4"]
    cost: Float[Array, ""]
    history: Float[Array, " steps"]
    steps: Int[Array, ""]
    stopped: Bool[Array, ""]
    converged: Bool[Array, ""]


def denominator(a: Float[Array, " 4"], omega: Float[Array, "*n"]) -> Complex[Array, "*n"]:
    """`a0 + a1 j omega - a2 omega^2` for coefficients `a` at angular frequencies `omega`."""
    return jax.lax.complex(a[0] - a[2] * omega**2, a[1] * omega)


def _complex(real: Float[Array, "*n"]) -> Complex[Array, "*n"]:
    return jax.lax.complex(real, jnp.zeros_like(real))


def _turn(angle: Float[Array, "*n"]) -> Complex[Array, "*n"]:
    return jax.lax.complex(jnp.cos(angle), jnp.sin(angle))


def sampled_response(a: Float[Array, " 4"], lines: Lines, hold: bool) -> Complex[Array, " n"]:
    """Response at the samples, shape `(n,)`, of the system with coefficients `a` at the frequencies of `lines`.

    With `hold`, the input is held between samples, and sampling folds the images of the response back (Poisson):

        H = zoh sum_m G(j w_m) w / w_m,   w_m = w + m w_s,   zoh = exp(-j pi w / w_s) sinc(w / w_s)

    The half-sample delay is in `zoh`; the images matter towards half of the sample rate (3 % of the response at a
    quarter of it). They fall with the fourth power of `m`: 16 on each side leave 2e-6 at a quarter.
    """
    omega = lines.omega
    delay = _turn(-omega * a[3])
    if not hold:
        return delay / denominator(a, omega)
    m = jnp.arange(-IMAGES, IMAGES + 1.0)[:, None]
    images = omega[None, :] + m * lines.sample_omega
    # At zero frequency the term is 0 / 0, with the limit one.
    share = jnp.where(m == 0.0, 1.0, omega[None, :] / jnp.where(m == 0.0, 1.0, images))
    part = omega / lines.sample_omega
    zoh = _complex(jnp.sinc(part)) * _turn(-jnp.pi * part)
    # A delay turns each image by its own frequency; the common factor stands outside the sum.
    turned = _complex(share) * _turn(-m * lines.sample_omega * a[3])
    return zoh * delay * jnp.sum(turned / denominator(a, images), axis=0)


def _cost(a: Float[Array, " 4"], lines: Lines, hold: bool) -> Float[Array, ""]:
    total = jnp.sum(lines.weight**2 * jnp.abs(lines.response - sampled_response(a, lines, hold)) ** 2)
    return jnp.where(jnp.isfinite(total), total, jnp.inf)


def _least_squares(
    columns: Complex[Array, "n p"], target: Complex[Array, " n"]
) -> tuple[Float[Array, " p"], Float[Array, "p p"]]:
    """Real solution of `columns @ p = target`, and the normal matrix."""
    normal = jnp.real(jnp.conj(columns).T @ columns)
    size = jnp.sqrt(jnp.diag(normal))
    size = jnp.where(size > 0.0, size, 1.0)
    scaled = normal / size[:, None] / size[None, :]
    return jnp.linalg.solve(scaled, jnp.real(jnp.conj(columns).T @ target) / size) / size, normal


def _widen(part: Float[Array, " p"]) -> Float[Array, " 4"]:
    """`part` with a zero for the delay where it is not fitted."""
    return jnp.concatenate([part, jnp.zeros(4 - part.size)])


def _levy(
    response: Complex[Array, " n"],
    weight: Float[Array, " n"],
    omega: Float[Array, " n"],
    D: Complex[Array, " n"] | None = None,
) -> Float[Array, " p"]:
    """Solution of `weight (response (a0 + a1 s + a2 s^2) - 1) = 0`, with the change of delay last where `D` is given.

    A response that lags by a further `T` fits when it is multiplied by `exp(s T)`: to first order, one more term
    `response D s T`, with `D` the denominator of the step before.
    """
    s = jax.lax.complex(jnp.zeros_like(omega), omega)
    columns = [response, response * s, response * s**2]
    if D is not None:
        columns.append(response * s * D)
    weight = _complex(weight)
    return _least_squares(weight[:, None] * jnp.stack(columns, axis=1), weight)[0]


def start(lines: Lines, delay: Float[Array, ""], hold: bool) -> Float[Array, " 4"]:
    """Coefficients, shape `(4,)`, from one linear solution with a given `delay`.

    It needs no guess: for the denominator by which Sanathanan and Koerner divide, it takes one over the measured
    response of `lines`, freed of the delays (that of `hold` included).
    """
    part = lines.omega / lines.sample_omega
    shift = lines.omega * delay + (jnp.pi * part if hold else jnp.zeros_like(part))
    response = lines.response * _turn(shift) / _complex(jnp.sinc(part) if hold else jnp.ones_like(part))
    return jnp.append(_levy(response, lines.weight * jnp.abs(lines.response), lines.omega), delay)


def _sanathanan_koerner(
    a: Float[Array, " 4"], lines: Lines, hold: bool, fit_delay: bool
) -> tuple[Float[Array, " 4"], Float[Array, ""]]:
    """The linear solution weighted by the denominator `D` at `a`; and infinity for its length, which is unknown."""
    D = denominator(a, lines.omega)
    # The factor of sampling, holding and the delay on 1 / D: removed from the data, at the present coefficients.
    sampling = sampled_response(a, lines, hold) * D
    response = lines.response / sampling
    weight = lines.weight * jnp.abs(sampling / D)
    new = _levy(response, weight, lines.omega, D if fit_delay else None)
    proposal = jnp.append(new[:3], a[3] + new[3]) if fit_delay else jnp.append(new, a[3])
    return proposal, jnp.asarray(jnp.inf)


def sensitivity(a: Float[Array, " 4"], lines: Lines, hold: bool, fit_delay: bool) -> Complex[Array, "n p"]:
    """Derivative of the weighted model of `lines` (with `hold`) by the coefficients `a`, shape `(n, 3)`.

    With `fit_delay` the delay is one more, shape `(n, 4)`.
    """
    columns = jax.jacfwd(lambda b: sampled_response(b, lines, hold))(a)
    return _complex(lines.weight)[:, None] * columns[:, : 4 if fit_delay else 3]


def _gauss_newton(
    a: Float[Array, " 4"], lines: Lines, hold: bool, fit_delay: bool
) -> tuple[Float[Array, " 4"], Float[Array, ""]]:
    """The step to the least sum of squares of the linearised residuals, and its length in standard errors, squared."""
    residual = _complex(lines.weight) * (lines.response - sampled_response(a, lines, hold))
    step, normal = _least_squares(sensitivity(a, lines, hold, fit_delay), residual)
    return a + _widen(step), step @ normal @ step


def _descend(
    propose: Callable[[Float[Array, " 4"]], tuple[Float[Array, " 4"], Float[Array, ""]]],
    state: Iteration,
    cost: Callable[[Float[Array, " 4"]], Float[Array, ""]],
    enough: float,
    freedom: Float[Array, ""],
) -> Iteration:
    """Take convex combinations of the coefficients and those proposed while the cost falls.

    A step is the best of the whole proposal, its half, its quarter and so on. It ends where none is better, where
    the cost falls by less than the part `enough`, or where the proposal is below 1e-4 standard errors.
    """

    def body(state):
        proposal, length = propose(state.a)
        tried = state.a[None, :] + SHORTENINGS[:, None] * (proposal - state.a)[None, :]
        costs = jax.vmap(cost)(tried)
        best = jnp.argmin(costs)
        better = costs[best] < state.cost
        new_cost = jnp.where(better, costs[best], state.cost)
        steps = state.steps + 1
        # Misfit enlarges the standard errors: lengths are measured by the actual residuals, not by the expected ones.
        length = length / jnp.maximum(1.0, state.cost / freedom)
        # Where rounding keeps the cost from falling, a small proposal counts as converged.
        converged = (length < 1e-8) | (~better & (length < 1e-4))
        return Iteration(
            jnp.where(better, tried[best], state.a),
            new_cost,
            state.history.at[steps].set(jnp.sqrt(new_cost)),
            steps,
            converged | ~better | (new_cost > (1.0 - enough) * state.cost),
            converged,
        )

    room = state.history.size - 1
    state = state._replace(stopped=jnp.asarray(False), converged=jnp.asarray(False))
    return jax.lax.while_loop(lambda s: ~s.stopped & (s.steps < room), body, state)


@eqx.filter_jit
def iterate(
    lines: Lines,
    delays: Float[Array, " starts"],
    *,
    hold: bool,
    fit_delay: bool,
    max_steps: int,
) -> tuple[Iteration, Float[Array, "4 4"]]:
    """Fit the coefficients to the measured response.

    First the iteration of Sanathanan and Koerner (1963), which needs no starting values, with steps shortened as in
    the paper's "convex combination steps"; when it gains no more, steps of Gauss and Newton on the weighted
    residuals themselves. The first alone has the measured response, noise included, among its regressors, and ends
    off the least-squares solution; the second removes that bias.

    **Arguments:**

    - `lines`: the `Lines`.
    - `delays`: delays to start from, of which the best is taken, shape `(starts,)`.
    - `hold`: whether the input is held between samples.
    - `fit_delay`: whether the delay is fitted too.
    - `max_steps`: most steps of both kinds together.

    **Returns:** the `Iteration`, and the normal matrix at its end, shape `(4, 4)`; the row and column of a delay that
    is not fitted are zero.
    """

    def cost(a):
        return _cost(a, lines, hold)

    starts = jax.vmap(lambda delay: start(lines, delay, hold))(delays)
    costs = jax.vmap(cost)(starts)
    first = jnp.argmin(costs)
    history = jnp.full(max_steps + 1, jnp.nan).at[0].set(jnp.sqrt(costs[first]))
    no = jnp.asarray(False)
    state = Iteration(starts[first], costs[first], history, jnp.asarray(0), no, no)
    freedom = jnp.maximum(2.0 * jnp.sum(jnp.where(lines.weight > 0.0, 1.0, 0.0)) - 4.0, 1.0)
    for propose, enough in ((_sanathanan_koerner, 1e-3), (_gauss_newton, 0.0)):
        state = _descend(lambda a, p=propose: p(a, lines, hold, fit_delay), state, cost, enough, freedom)
    columns = sensitivity(state.a, lines, hold, fit_delay)
    normal = jnp.real(jnp.conj(columns).T @ columns)
    spare = 4 - normal.shape[0]
    return state, jnp.pad(normal, ((0, spare), (0, spare)))
