"""Best linear approximation from periodic data, and the level of nonlinear distortion."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy.special import betainc
from jaxtyping import Array, ArrayLike, Complex, Float, Int

from frictionjax.core import InputError, require_x64
from frictionjax.excitation import MultisineLines, silent_lines
from frictionjax.frequency.frf import FRF


class Detection(eqx.Module):
    """The output on detection lines, which the input leaves silent.

    **Attributes:**

    - `frequency`: Hz, shape `(d,)`.
    - `level`: root mean square of the output on each line, over the realisations, in its unit, shape `(d,)`.
    - `noise`: what noise alone would leave there, from the scatter over the periods, shape `(d,)`.
    - `ratio`: root mean square of `level` over that of `noise`, shape `()`: about 1 for a linear machine, 0 where
        there are no such lines or no noise.
    - `freedom`: degrees of freedom of the numerator and of the denominator of its square, shape `(2,)`.
    """

    frequency: Float[Array, " d"]
    level: Float[Array, " d"]
    noise: Float[Array, " d"]
    ratio: Float[Array, ""]
    freedom: Float[Array, " 2"]

    @property
    def p_value(self) -> Float[Array, ""]:
        """Probability that noise alone makes `ratio` as large or larger: that of the F distribution, shape `()`."""
        above, below = self.freedom[0], self.freedom[1]
        return betainc(below / 2.0, above / 2.0, below / (below + above * self.ratio**2))

    @property
    def distortion(self) -> Float[Array, ""]:
        """Root mean square of the distortion on a line, noise taken off, in the unit of the output."""
        if self.level.size == 0:
            return jnp.asarray(0.0)
        return jnp.sqrt(jnp.maximum(jnp.mean(self.level**2 - self.noise**2), 0.0))


class BLA(eqx.Module):
    """The best linear approximation of a machine at one class of excitation.

    Variances are those of complex numbers: of the real and the imaginary part together.

    **Attributes:**

    - `frequency`: the excited lines, Hz, shape `(f,)`.
    - `response`: output unit per input unit, the mean over the realisations, shape `(f,)`.
    - `noise_variance`: variance of `response` by noise, from the scatter over the periods, shape `(f,)`.
    - `total_variance`: its variance by noise and nonlinearity, from the scatter over the realisations, shape `(f,)`;
        None for a single realisation, which does not show it.
    - `output`: root mean square of the output on each excited line, shape `(f,)`.
    - `output_noise`: what noise contributes to it, shape `(f,)`.
    - `odd`: the `Detection` on silent odd lines: friction and other odd nonlinearities.
    - `even`: the `Detection` on silent even lines: asymmetry and other even nonlinearities.
    - `sample_rate`: samples per second, Hz, shape `()`.
    - `periods`: how many periods of each realisation were used.
    - `realisations`: how many realisations there were.
    """

    frequency: Float[Array, " f"]
    response: Complex[Array, " f"]
    noise_variance: Float[Array, " f"]
    total_variance: Float[Array, " f"] | None
    output: Float[Array, " f"]
    output_noise: Float[Array, " f"]
    odd: Detection
    even: Detection
    sample_rate: Float[Array, ""]
    periods: int = eqx.field(static=True)
    realisations: int = eqx.field(static=True)

    @property
    def nonlinear_variance(self) -> Float[Array, " f"] | None:
        """Variance that the nonlinearity gives the response of one realisation, shape `(f,)`; None for only one."""
        if self.total_variance is None:
            return None
        return self.realisations * jnp.maximum(self.total_variance - self.noise_variance, 0.0)

    def frf(self) -> FRF:
        """The same as an `FRF`, for `fit_sk`: with the total variance where there is one, else that of the noise."""
        if self.total_variance is None:
            variance, averages = self.noise_variance, self.periods
        else:
            variance, averages = self.total_variance, self.realisations
        one = jnp.asarray(1.0)
        power = jnp.abs(self.response) ** 2
        spread = averages * variance
        whole = power + spread
        return FRF(
            frequency=self.frequency,
            response=self.response,
            coherence=jnp.where(whole > 0.0, power / jnp.where(whole > 0.0, whole, 1.0), 0.0),
            std=jnp.sqrt(0.5 * variance),
            averages_effective=averages * one,
            sample_rate=self.sample_rate,
            bin_correlation=one,
        )


def best_linear_approximation(
    u: ArrayLike,
    x: ArrayLike,
    sample_rate: ArrayLike,
    *,
    period: int,
    lines: MultisineLines | Sequence[int] | np.ndarray,
    transient: int = 1,
    correct_input: bool = True,
) -> BLA:
    """Linear response, noise and nonlinear distortion from an input that repeats itself.

    With `U_mp`, `X_mp` the Fourier transforms of period `p` of realisation `m`, the response is the mean over `m` of
    `mean_p X / mean_p U`. What differs from period to period is noise; what a period repeats on lines that the input
    leaves silent is distortion; what differs from realisation to realisation beyond the noise is the nonlinearity's
    own scatter (the robust and the fast method of Pintelon and Schoukens, System Identification, 2nd ed., 2012,
    ch. 4). No window is needed, and there is no leakage.

    **Arguments:**

    - `u`: input, shape `(n,)`, or `(m, n)` for `m` realisations of the phases.
    - `x`: output, sampled at the same instants, of the same shape.
    - `sample_rate`: samples per second, Hz.
    - `period`: samples in a period. A last period that is cut short is left out.
    - `lines`: lines that are excited, as multiples of `sample_rate / period`, or the `MultisineLines`.
    - `transient`: periods left out at the start, while the machine settles.
    - `correct_input`: whether the input's own content on the silent lines, times the response interpolated between
        the neighbouring excited lines, is subtracted from the output there; for measured inputs and closed loops.

    **Returns:** the `BLA`.

    **Raises:** `InputError` when `u` and `x` differ in shape, hold values that are not finite or fewer than two
        periods after the transient, or when a line of `lines` cannot be, or has no power in the input;
        `PrecisionError` when JAX computes in float32.
    """
    require_x64()
    u, x = _checked("u", u), _checked("x", x)
    if u.shape != x.shape:
        raise InputError(
            f"`u` has the shape {u.shape} and `x` the shape {x.shape}", cure="Cut both to the same instants."
        )
    excited = np.unique(lines.excited if isinstance(lines, MultisineLines) else np.asarray(lines, int))
    if excited.size == 0 or excited[0] < 1 or 2 * excited[-1] >= period:
        raise InputError(
            f"`lines` holds {excited.size} lines that reach to {excited.max(initial=0)}",
            cure=f"A period of {period} samples carries the lines 1 to {(period - 1) // 2}.",
        )
    periods = u.shape[1] // period - transient
    if transient < 0 or periods < 2:
        raise InputError(
            f"`u` holds {u.shape[1] / period:.4g} periods of {period} samples, of which `transient` = {transient} are "
            "left out: noise shows between two periods or more",
            cure="Record more periods, or check `period`.",
        )
    silent = silent_lines(excited, 1.0)
    cut = slice(transient * period, (transient + periods) * period)
    U, X = _periods(u[:, cut], x[:, cut], period)
    if not isinstance(U, Tracer):
        power = np.min(np.abs(np.mean(np.asarray(U), axis=1)), axis=0)
        bad = excited[power[excited] <= 1e-10 * np.max(power)]
        if bad.size:
            raise InputError(
                f"the input has no power on {bad.size} of {excited.size} `lines`, the first {bad[0]}",
                cure="Check `period`, and that `lines` are multiples of sample_rate / period.",
            )
    rate = jnp.asarray(sample_rate, float)
    places = [jnp.asarray(part) for part in (excited, silent.odd, silent.even)]
    return _bla(U, X, rate, period, places, correct_input)


def _checked(name: str, values: ArrayLike) -> Float[Array, "m n"]:
    values = jnp.asarray(values, float)
    if values.ndim not in (1, 2):
        raise InputError(
            f"`{name}` has the shape {values.shape}",
            cure="Give one record of shape (n,) or realisations of shape (m, n).",
        )
    if not isinstance(values, Tracer) and not np.all(np.isfinite(np.asarray(values))):
        raise InputError(
            f"`{name}` holds values that are not finite",
            cure="Cut the record before them, or repair the gap.",
        )
    return jnp.atleast_2d(values)


@eqx.filter_jit
def _periods(
    u: Float[Array, "m samples"], x: Float[Array, "m samples"], period: int
) -> tuple[Complex[Array, "m p n"], Complex[Array, "m p n"]]:
    """Fourier coefficients of each period."""
    parts = jnp.stack([u, x]).reshape(2, u.shape[0], -1, period)
    U, X = jnp.fft.rfft(parts, axis=3) / period
    return U, X


@eqx.filter_jit
def _bla(
    U: Complex[Array, "m p n"],
    X: Complex[Array, "m p n"],
    sample_rate: Float[Array, ""],
    period: int,
    places: list[Int[Array, " _"]],
    correct_input: bool,
) -> BLA:
    excited, odd, even = places
    m, periods = U.shape[:2]
    u, x = U[:, :, excited], X[:, :, excited]
    mean_u, mean_x = jnp.mean(u, axis=1), jnp.mean(x, axis=1)
    each = mean_x / mean_u
    response = jnp.mean(each, axis=0)
    # The residual of a period from the mean response to its own input: input noise is noise of the response too.
    noise = _variance(x - each[:, None, :] * u) / jnp.abs(mean_u) ** 2
    total = None
    if m > 1:
        total = jnp.sum(jnp.abs(each - response[None, :]) ** 2, axis=0) / (m * (m - 1))
    spacing = sample_rate / period

    def detect(lines: Int[Array, " d"]) -> Detection:
        answer = X[:, :, lines]
        if correct_input and lines.size:
            answer = answer - _between(each, excited, lines)[:, None, :] * U[:, :, lines]
        return _detection(answer, spacing * lines.astype(float))

    return BLA(
        frequency=spacing * excited.astype(float),
        response=response,
        noise_variance=jnp.mean(noise, axis=0) / m,
        total_variance=total,
        output=jnp.sqrt(2.0 * jnp.mean(jnp.abs(mean_x) ** 2, axis=0)),
        output_noise=jnp.sqrt(2.0 * jnp.mean(_variance(x), axis=0)),
        odd=detect(odd),
        even=detect(even),
        sample_rate=sample_rate,
        periods=periods,
        realisations=m,
    )


def _variance(part: Complex[Array, "m p n"]) -> Float[Array, "m n"]:
    """Variance of the mean over the periods."""
    periods = part.shape[1]
    off = part - jnp.mean(part, axis=1, keepdims=True)
    return jnp.sum(jnp.abs(off) ** 2, axis=1) / (periods * (periods - 1))


def _between(
    response: Complex[Array, "m f"], excited: Int[Array, " f"], lines: Int[Array, " d"]
) -> Complex[Array, "m d"]:
    """The response on silent `lines`, on straight lines between the excited ones."""
    right = jnp.clip(jnp.searchsorted(excited, lines), 1, excited.size - 1)
    left = right - 1
    part = (lines - excited[left]).astype(float) / (excited[right] - excited[left]).astype(float)
    part = part.astype(response.dtype)[None, :]
    return (1.0 - part) * response[:, left] + part * response[:, right]


def _detection(answer: Complex[Array, "m p d"], frequency: Float[Array, " d"]) -> Detection:
    m, periods, count = answer.shape
    # A line of the complex amplitude c is a sine of the mean square 2 |c|^2.
    level = 2.0 * jnp.mean(jnp.abs(jnp.mean(answer, axis=1)) ** 2, axis=0)
    noise = 2.0 * jnp.mean(_variance(answer), axis=0)
    if count == 0:
        return Detection(frequency, level, noise, jnp.asarray(0.0), jnp.ones(2))
    total = jnp.sum(noise)
    noisy = total > 0.0
    safe = jnp.where(noisy, total, 1.0)
    ratio = jnp.where(noisy, jnp.sum(level) / safe, 0.0)
    # Satterthwaite: lines of unequal noise count as fewer. The square of an estimate of `own` degrees of freedom is
    # too large by 1 + 1 / own.
    own = m * (periods - 1)
    worth = jnp.where(noisy, safe**2 / jnp.where(noisy, jnp.sum(noise**2) / (1.0 + 1.0 / own), 1.0), 1.0)
    freedom = 2.0 * worth * jnp.array([m, own], float)
    return Detection(frequency, jnp.sqrt(level), jnp.sqrt(noise), jnp.sqrt(ratio), freedom)
