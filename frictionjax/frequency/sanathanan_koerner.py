"""Inertia, stiffness and damping from a frequency response, as in the paper's Fig. 4(b)."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from frictionjax.core import Estimate, InputError, public_verb, require_x64
from frictionjax.core.display import AbstractDisplayed, Display, estimates_grid
from frictionjax.core.frames import estimate_columns, to_dataframe
from frictionjax.frequency.frf import FRF
from frictionjax.frequency.second_order import Lines, iterate, sampled_response

_fitted = eqx.filter_jit(sampled_response)
FREEDOM = 50.0  # degrees of freedom that each bin's variance should rest on


class SKResult(AbstractDisplayed):
    """The second-order system that fits a frequency response.

    **Attributes:**

    - `J`: inertia, force s^2 per position unit.
    - `stiffness`: presliding stiffness, force per position unit; that of the whole drive, as the paper warns.
    - `damping`: presliding damping, force s per position unit; `sigma1 + sigma2` of a LuGre model.
    - `delay`: delay of the output beyond that of the hold, s; zero and exact unless it was fitted.
    - `natural_frequency`: `sqrt(stiffness / J) / (2 pi)`, Hz; zero and not identified unless both are positive.
    - `damping_ratio`: `damping / (2 sqrt(stiffness J))`.
    - `frequency`: the bins that were fitted, Hz, shape `(n,)`.
    - `response`: the fitted response there, output unit per input unit, shape `(n,)`.
    - `residual_norm`: root of the weighted sum of squares, at the start and after each step, shape `(steps + 1,)`.
    - `misfit`: power of the residual over that of the noise: 1 where the system is of second order.
    - `converged`: whether the last step was below a small part of the standard errors.
    - `message`: how the iteration ended, as a sentence.
    - `warnings`: what a reader of the numbers must know, as sentences.
    - `measured`, `std`: the measured response at `frequency`, shape `(n,)`, and its standard deviation.
    """

    J: Estimate
    stiffness: Estimate
    damping: Estimate
    delay: Estimate
    natural_frequency: Estimate
    damping_ratio: Estimate
    frequency: Float[np.ndarray, " n"]
    response: Complex[np.ndarray, " n"]
    residual_norm: Float[np.ndarray, " steps"]
    misfit: float = eqx.field(static=True)
    converged: bool = eqx.field(static=True)
    message: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    measured: Complex[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Name -> `Estimate`."""
        names = ("J", "stiffness", "damping", "delay", "natural_frequency", "damping_ratio")
        return {name: getattr(self, name) for name in names}

    def _display(self) -> Display:
        low, high = self.frequency[0], self.frequency[-1]
        title = f"Second-order system fitted from {low:.4g} to {high:.4g} Hz, misfit {self.misfit:.3g}"
        return Display(title, (self.message, *self.warnings), (estimates_grid(self.parameters),))

    def plot(self, **how: Any) -> Any:
        """Draw the measured and the fitted response, magnitude and phase over frequency: `frictionjax.plot`, with `how`
        as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each parameter: `value`, `stderr`, `unit`, `identified`."""
        return to_dataframe(estimate_columns(self.parameters), index="parameter")


def fit_sk(
    frf: FRF,
    band: tuple[float, float],
    *,
    motor_constant: float = 1.0,
    fit_delay: bool = False,
    hold: bool = True,
    max_steps: int = 50,
    units: Mapping[str, str] | None = None,
) -> SKResult:
    """Fit `G = motor_constant / (J (jw)^2 + damping jw + stiffness)`, the paper's (6), to a frequency response.

    The iteration is that of Sanathanan and Koerner with convex combination steps, then least squares proper (see
    `second_order.iterate`). Each bin is weighted by one over its variance, smoothed over as many neighbours as a
    steady value needs. The standard errors are those of weighted least squares, made wider for what bins share
    through the window, for weights that are estimates themselves, and for misfit.

    **Arguments:**

    - `frf`: the `FRF`, from input to position, of motion in presliding.
    - `band`: lowest and highest frequency to fit, Hz. Stay below the structure's next resonance.
    - `motor_constant`: force per input unit; without it, the results are per unit of it.
    - `fit_delay`: whether a delay is fitted too. An unmodelled one of `T` adds `stiffness * T` to the damping and
        takes about `damping * T` from `J`.
    - `hold`: whether the input was held between the samples (a digital controller). Its half sample of delay, and
        what sampling folds back, are then part of the model.
    - `max_steps`: most steps of the iteration.
    - `units`: names for `force` and `position`, as in `{"force": "N*m", "position": "rad"}`.

    **Returns:** the `SKResult`.

    **Raises:** `InputError` when `band` holds fewer than four bins in which the input has power, `motor_constant` is
        zero, `max_steps` is below one, the output does not move, or its coherence is no more than chance gives;
        `PrecisionError` when JAX computes in float32.
    """
    require_x64()
    if motor_constant == 0.0 or max_steps < 1:
        raise InputError(
            f"`motor_constant` is {motor_constant} and `max_steps` is {max_steps}",
            cure="The first must not be zero and the second at least one.",
        )
    frequency, std = np.asarray(frf.frequency), np.asarray(frf.std)
    if frequency.ndim != 1:
        raise InputError(
            f"`frf` holds a batch of shape {frequency.shape[:-1]}",
            cure="Fit one response at a time: `jax.tree.map(lambda part: part[i], frf)` is the one numbered i.",
        )
    low, high = band
    inside = (frequency >= low) & (frequency <= high) & np.isfinite(std)
    inside &= np.isfinite(np.asarray(frf.response))
    if inside.any() and not np.any(np.asarray(frf.response)[inside]):
        raise InputError(
            f"the output does not answer the input anywhere from {low} to {high} Hz: it has no power there",
            cure="Check the output's channel and its wiring, or excite more.",
        )
    inside &= np.asarray(frf.response) != 0.0
    if inside.sum() < 4:
        raise InputError(
            f"`band` from {low} to {high} Hz holds {inside.sum()} bins in which the input has power",
            cure=f"Widen it; the bins are {frequency[1]:.4g} Hz apart and reach {frequency[-1]:.5g} Hz. A longer "
            "`segment` makes more of them.",
        )
    _check_coherence(np.asarray(frf.coherence)[inside], frf, low, high)
    frequency, response = frequency[inside], np.asarray(frf.response)[inside]
    variance, freedom = _smoothed(std[inside] ** 2, frf)
    # The variance of data without noise is rounding error: this limits the weight of a bin to nine digits.
    variance = variance + (1e-9 * np.abs(response)) ** 2

    unit_w, unit_H = 2.0 * np.pi * frequency[-1], float(np.max(np.abs(response)))
    lines = _padded(
        2.0 * np.pi * frequency / unit_w,
        response / unit_H,
        unit_H / np.sqrt(variance),
        2.0 * np.pi * float(frf.sample_rate) / unit_w,
    )
    delays = np.linspace(-0.25, 1.0, 21) * 2.0 * np.pi if fit_delay else np.zeros(1)
    state, normal = iterate(lines, jnp.asarray(delays), hold=hold, fit_delay=fit_delay, max_steps=max_steps)

    count = 4 if fit_delay else 3
    excess = (1.0 - 2.0 / freedom) * float(state.cost) / (2 * frequency.size - count)
    # Weights that are themselves estimates with `freedom` degrees of freedom cost 1 / (1 - 4 / freedom) in variance.
    wider = float(frf.bin_correlation) * max(1.0, excess) / (1.0 - 4.0 / freedom)
    # From (a0, a1, a2, delay), scaled, to (stiffness, damping, J, delay).
    scale = np.array([motor_constant / unit_H / unit_w**i for i in range(3)] + [1.0 / unit_w])
    values = scale * np.asarray(state.a)
    covariance = wider * scale[:, None] * scale[None, :] * _inverse(np.asarray(normal), count)
    names = {"force": "force", "position": "position", **(units or {})}
    estimates = _estimates(values, covariance, names["force"], names["position"])
    steps, converged = int(state.steps), bool(state.converged)
    return SKResult(
        **estimates,
        frequency=frequency,
        response=unit_H * np.asarray(_fitted(state.a, lines, hold))[: frequency.size],
        residual_norm=np.asarray(state.history)[: steps + 1],
        misfit=excess,
        converged=converged,
        message=_message(converged, steps, max_steps),
        warnings=_warnings(estimates, excess, frequency, frf, converged),
        measured=response,
        std=np.sqrt(variance),
    )


def _check_coherence(coherence: Float[np.ndarray, " n"], frf: FRF, low: float, high: float) -> None:
    """Refuse a response that unrelated signals would give as well."""
    # An average over n segments gives unrelated signals a coherence of 1 / n, which 1 % of the bins exceed by as much
    # as `rare`.
    n = max(float(frf.averages_effective), 1.0 + 1e-9)
    bins = max(coherence.size / float(frf.bin_correlation), 1.0)
    rare = 1.0 - 0.01 ** (1.0 / (n - 1.0))
    if coherence.mean() < (1.0 + 3.0 / np.sqrt(bins)) / n and np.mean(coherence >= rare) < 0.1:
        raise InputError(
            f"the coherence from {low} to {high} Hz is {coherence.mean():.2g}, no more than unrelated signals show "
            f"({1.0 / n:.2g})",
            cure="Check that input and output belong together and are aligned in time, record longer, or excite more.",
        )


def _smoothed(variance: Float[np.ndarray, " n"], frf: FRF) -> tuple[Float[np.ndarray, " n"], float]:
    """Running mean of the bins' variances, and the degrees of freedom that it rests on."""
    own = 2.0 * max(float(frf.averages_effective) - 1.0, 0.5)
    half = int(np.ceil((FREEDOM * float(frf.bin_correlation) / own - 1.0) / 2.0)) if own < FREEDOM else 0
    half = min(half, (variance.size - 1) // 2)
    total = np.concatenate([[0.0], np.cumsum(variance)])
    place = np.arange(variance.size)
    first, last = np.maximum(place - half, 0), np.minimum(place + half + 1, variance.size)
    freedom = own * max(1.0, (2 * half + 1) / float(frf.bin_correlation))
    return np.maximum(total[last] - total[first], 0.0) / (last - first), max(freedom, 6.0)


def _padded(
    omega: Float[np.ndarray, " n"],
    response: Complex[np.ndarray, " n"],
    weight: Float[np.ndarray, " n"],
    sample_omega: float,
) -> Lines:
    """The bins as `Lines`, padded with zero weight to 256, 1024, 4096, ...: most bands share a compilation."""
    size = 256
    while size < omega.size:
        size *= 4
    spare = size - omega.size
    return Lines(
        jnp.asarray(np.pad(omega, (0, spare), mode="edge")),
        jnp.asarray(np.pad(response, (0, spare), mode="edge")),
        jnp.asarray(np.pad(weight, (0, spare))),
        jnp.asarray(sample_omega),
    )


def _inverse(normal: Float[np.ndarray, "4 4"], count: int) -> Float[np.ndarray, "4 4"]:
    """Inverse of the leading `count` rows and columns; infinite variances when they do not determine them."""
    covariance = np.zeros((4, 4))
    size = np.sqrt(np.diag(normal)[:count])
    with np.errstate(all="ignore"):
        scaled = normal[:count, :count] / size[:, None] / size[None, :]
    if not np.all(np.isfinite(scaled)) or np.linalg.cond(scaled) > 1e12:
        covariance[range(count), range(count)] = np.inf
    else:
        covariance[:count, :count] = np.linalg.inv(scaled) / size[:, None] / size[None, :]
    return covariance


def _estimates(
    values: Float[np.ndarray, " 4"], covariance: Float[np.ndarray, "4 4"], force: str, position: str
) -> dict[str, Estimate]:
    stiffness, damping, J, delay = (float(value) for value in values)

    def estimate(value, gradient, unit, *, positive=True):
        stderr = float(np.sqrt(max(gradient @ covariance @ gradient, 0.0)))
        return Estimate(
            float(value), stderr, unit, np.isfinite(stderr) and not (positive and value <= stderr)
        )

    unit = np.eye(4)
    estimates = {
        "stiffness": estimate(stiffness, unit[0], f"{force}/{position}"),
        "damping": estimate(damping, unit[1], f"{force}*s/{position}"),
        "J": estimate(J, unit[2], f"{force}*s^2/{position}"),
        "delay": estimate(delay, unit[3], "s", positive=False),
    }
    if not (stiffness > 0.0 and J > 0.0 and np.all(np.isfinite(covariance))):
        nothing = {"stderr": float("inf"), "identified": False}
        # Nothing oscillates: a warning names the coefficient at fault.
        estimates["natural_frequency"] = Estimate(0.0, unit="Hz", **nothing)
        estimates["damping_ratio"] = Estimate(0.0, unit="1", **nothing)
        return estimates
    fn, ratio = np.sqrt(stiffness / J) / (2.0 * np.pi), damping / (2.0 * np.sqrt(stiffness * J))
    estimates["natural_frequency"] = estimate(fn, fn * np.array([0.5 / stiffness, 0.0, -0.5 / J, 0.0]), "Hz")
    by_damping = 0.5 / np.sqrt(stiffness * J)
    gradient = np.array([-0.5 * ratio / stiffness, by_damping, -0.5 * ratio / J, 0.0])
    estimates["damping_ratio"] = estimate(ratio, gradient, "1")
    return estimates


def _message(converged: bool, steps: int, max_steps: int) -> str:
    if converged:
        return f"Converged after {steps} steps."
    if steps >= max_steps:
        return f"Not converged after {steps} steps; raise `max_steps`, or fit a band with one resonance."
    return (
        f"Stopped after {steps} steps without converging: no step lowers the residual; choose another band."
    )


def _warnings(
    estimates: dict[str, Estimate],
    excess: float,
    frequency: Float[np.ndarray, " n"],
    frf: FRF,
    converged: bool,
) -> tuple[str, ...]:
    found = []
    if all(estimates[name].value < 0.0 for name in ("J", "stiffness", "damping")):
        found.append(
            "negative J, stiffness and damping: the output has the opposite sign; give `motor_constant` the other sign."
        )
    cures = {
        "J": "the band ends before inertia shows, or the data have a delay that the model lacks; extend `band` "
        "upwards, or set fit_delay=True.",
        "stiffness": "the band begins above the resonance, or the machine slid; extend `band` downwards, or excite "
        "well below break-away.",
        "damping": "the position leads the input; check that both were sampled at the same instants, and whether "
        "the input was held (`hold`).",
    }
    for name, cure in cures.items():
        estimate = estimates[name]
        if estimate.value <= 0.0:
            found.append(
                f"negative {name}: {estimate.value:.4g} with standard error {estimate.stderr:.2g}; {cure}"
            )
        elif not estimate.identified:
            found.append(f"{name} is not determined by this band: its standard error exceeds its value.")
    fn = estimates["natural_frequency"].value
    if fn > 0.0 and not frequency[0] <= fn <= frequency[-1]:
        found.append(
            f"the resonance at {fn:.4g} Hz lies outside the band from {frequency[0]:.4g} to {frequency[-1]:.4g} Hz: "
            "inertia or stiffness is an extrapolation of the model."
        )
    # Five standard errors of a mean over this many independent numbers, beyond one half of allowance.
    if excess > 1.5 + 5.0 * np.sqrt(float(frf.bin_correlation) / frequency.size):
        found.append(
            f"misfit: the residual has {excess:.3g} times the power that the coherence allows, so the response is not "
            "of second order in this band; excite less (friction is not linear), narrow `band`, or check for a delay "
            "or a second resonance."
        )
    if float(frf.averages_effective) < 4.0:
        found.append(
            f"the response averages {float(frf.averages_effective):.2g} independent segments: coherence and standard "
            "errors are rough; choose a shorter `segment`."
        )
    if not converged:
        found.append("the iteration did not converge: the numbers are those of its last step.")
    return tuple(found)
