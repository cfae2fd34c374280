"""The bristle stiffness sigma0: the limit of the measured stiffness at zero amplitude.

The measured stiffness falls with the level, in these powers. Near rest the bristles obey
`z' = v - |v| z / z_s` with `z_s = Fs / sigma0`. In Gaussian motion `z` and `v` of one instant are independent, so the
linear part of `|v| z` is `E|v| z` (Bussgang): linearised, the bristles leak at the rate `rate = E|v| / z_s`, and
the friction `sigma0 z + sigma1 z'` is `(sigma0 + sigma1 jw) jw / (jw + rate)` times the position. Its real part, the
stiffness, is

    (sigma0 - sigma1 rate) w^2 / (w^2 + rate^2) = sigma0 (1 - (sigma1 / sigma0) rate - rate^2 / w^2 + ...).

The rate is proportional to the level as long as little is lost. So the first power of the level comes from the
bristles' damping, the second from their leak, and which of them dominates depends on the machine and the band. Where a
band reaches down to the rate, the leak too goes with the first power. The damping gains `sigma0 rate / w^2`.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, Float

from frictionjax.core import Estimate, InputError

FORMS = {
    "the level": (1,),
    "the level squared": (2,),
    "the level and its square": (1, 2),
    "the level, its square and cube": (1, 2, 3),
}
"""Powers of the level beside the constant, by their name in a sentence."""


class ZeroAmplitude(eqx.Module):
    """The stiffness at zero amplitude: `sigma0` of a LuGre model.

    **Attributes:**

    - `stiffness`: its value; the standard error includes noise and the choice of a curve.
    - `levels`: the levels, ascending, in any unit, shape `(k,)`.
    - `measured`: the stiffness measured there, shape `(k,)`.
    - `stderr`: its standard error, shape `(k,)`.
    - `coefficients`: of `stiffness = sum_i c_i level^i`, shape `(4,)`: the mean over the curves.
    - `weight`: the part that a level has in the curves used, 1 for one that is in all of them, shape `(k,)`.
    - `highest`: the highest level with a weight of one half or more.
    - `message`: which levels and which powers the value rests on, as a sentence.
    - `warnings`: what a reader of the number must know, as sentences.
    """

    stiffness: Estimate
    levels: Float[np.ndarray, " k"]
    measured: Float[np.ndarray, " k"]
    stderr: Float[np.ndarray, " k"]
    coefficients: Float[np.ndarray, " 4"]
    weight: Float[np.ndarray, " k"]
    highest: float = eqx.field(static=True)
    message: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)

    def curve(self, levels: ArrayLike | Sequence[float]) -> Float[np.ndarray, " n"] | np.floating:
        """The fitted stiffness at `levels`, shape `(n,)`; above `highest` it is an extrapolation."""
        return np.polynomial.polynomial.polyval(np.asarray(levels, float), self.coefficients)


def extrapolate_to_zero_amplitude(
    levels: ArrayLike | Sequence[float],
    stiffness: ArrayLike | Sequence[float],
    stderr: ArrayLike | Sequence[float],
    *,
    unit: str = "force/position",
) -> ZeroAmplitude:
    """Stiffness at zero amplitude from what was measured at three levels or more.

    Each form (powers of the level: see the head of this file) is fitted by weighted least squares to the lowest `n`
    levels, for every `n` that determines it. A fit counts with the weight `exp(-(chi2 + 2 p + 2 (k - n)) / 2)`, with
    `chi2` its misfit and `p` its coefficients: each level left out costs what a coefficient costs (Jay and Neil,
    Phys. Rev. D 103, 114502, 2021). So neither form nor highest level is chosen by the answer. The value is the
    weighted mean, its variance that of the fits plus their scatter. Where even the best fit misses its points, the
    errors of all are made wider by it.

    **Arguments:**

    - `levels`: levels of the excitation, in any unit, all above zero, shape `(k,)`; several records at one level
        are several entries.
    - `stiffness`: fitted stiffness at each (`fit_sk`), shape `(k,)`.
    - `stderr`: its standard error, shape `(k,)`.
    - `unit`: unit of the stiffness.

    **Returns:** the `ZeroAmplitude`.

    **Raises:** `InputError` when the shapes differ, a value is not finite, a level or a standard error is not
        positive, or there are fewer than three different levels.
    """
    L, y, s = _checked(levels, stiffness, stderr)
    scale_L, scale_y = L[-1], float(np.max(np.abs(y)))
    fits = _fits(L / scale_L, y / scale_y, s / scale_y)
    # Leaving out a level lowers chi2: standard errors that are too small would favour it. The best fit scales them.
    best = min((fit for fit in fits if fit["freedom"] > 0), key=lambda fit: fit["score"])
    wider = max(1.0, best["chi2"] / best["freedom"])
    score = np.array([fit["chi2"] / wider + 2.0 * fit["penalty"] for fit in fits])
    share = np.exp(-0.5 * (score - score.min()))
    share /= share.sum()
    c = np.array([fit["c"] for fit in fits])
    mean = share @ c
    variance = share @ (np.array([fit["variance"] for fit in fits]) * wider + (c[:, 0] - mean[0]) ** 2)
    weight = np.array([share @ [fit["n"] > i for fit in fits] for i in range(L.size)])
    value, error = float(scale_y * mean[0]), float(scale_y * np.sqrt(variance))
    used = L[weight >= 0.5]
    by_form = {
        name: sum(w for w, fit in zip(share, fits, strict=True) if fit["form"] == name) for name in FORMS
    }
    return ZeroAmplitude(
        stiffness=Estimate(value, error, unit, value > error),
        levels=L,
        measured=y,
        stderr=s,
        coefficients=scale_y * mean / scale_L ** np.arange(4),
        weight=weight,
        highest=float(used[-1]),
        message=_message(used, L, by_form),
        warnings=_warnings(value, error, y, s, wider),
    )


def _checked(
    levels: ArrayLike | Sequence[float],
    stiffness: ArrayLike | Sequence[float],
    stderr: ArrayLike | Sequence[float],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    L, y, s = (np.asarray(part, float) for part in (levels, stiffness, stderr))
    if L.ndim != 1 or not L.shape == y.shape == s.shape:
        raise InputError(
            f"`levels`, `stiffness` and `stderr` have the shapes {L.shape}, {y.shape} and {s.shape}",
            cure="Give one value of each for each level, as arrays of the shape (k,).",
        )
    good = np.isfinite(L) & np.isfinite(y) & np.isfinite(s) & (L > 0.0) & (s > 0.0)
    if not np.all(good):
        i = int(np.flatnonzero(~good)[0])
        raise InputError(
            f"entry {i} is level {L[i]}, stiffness {y[i]}, standard error {s[i]}",
            cure="Levels and standard errors must be positive and everything finite; leave out a level whose fit "
            "determines no stiffness.",
        )
    if np.unique(L).size < 3:
        raise InputError(
            f"`levels` holds {np.unique(L).size} different levels and a curve to zero amplitude needs three",
            cure="Repeat the experiment at a lower level, such as one half of the lowest.",
        )
    order = np.argsort(L, kind="stable")
    return L[order], y[order], s[order]


def _fits(
    L: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"], s: Float[np.ndarray, " k"]
) -> list[dict[str, Any]]:
    """Every form fitted to the lowest `n` levels, for every `n` that determines it and splits no level."""
    found = []
    for form, powers in FORMS.items():
        columns = L[:, None] ** np.array([0, *powers])
        count = len(powers) + 1
        for n in range(count, L.size + 1):
            whole = n == L.size or L[n] > L[n - 1]
            if not whole or np.unique(L[:n]).size < count:
                continue
            A = columns[:n] / s[:n, None]
            part = np.linalg.lstsq(A, y[:n] / s[:n], rcond=None)[0]
            chi2 = float(np.sum((A @ part - y[:n] / s[:n]) ** 2))
            c = np.zeros(4)
            c[[0, *powers]] = part
            penalty = count + L.size - n
            found.append(
                {
                    "form": form,
                    "n": n,
                    "c": c,
                    "variance": float(np.linalg.inv(A.T @ A)[0, 0]),
                    "chi2": chi2,
                    "freedom": n - count,
                    "penalty": penalty,
                    "score": chi2 + 2.0 * penalty,
                }
            )
    return found


def _message(used: Float[np.ndarray, " used"], L: Float[np.ndarray, " k"], by_form: dict[str, Any]) -> str:
    forms = [f"{100.0 * share:.0f} % {name}" for name, share in by_form.items() if share >= 0.05]
    return (
        f"Extrapolated from {used.size} of {L.size} measurements, at levels from {used[0]:.4g} to {used[-1]:.4g}, "
        f"with curves in powers of the level, by weight: {', '.join(forms)}."
    )


def _warnings(
    value: float, error: float, y: Float[np.ndarray, " k"], s: Float[np.ndarray, " k"], wider: float
) -> tuple[str, ...]:
    found = []
    if wider > 3.0:
        found.append(
            f"the measurements scatter about the best curve with {wider:.3g} times the variance of their standard "
            "errors; the error of the result is enlarged accordingly: measure at lower levels."
        )
    if value < y[0] - 2.0 * np.hypot(error, s[0]):
        found.append(
            f"the stiffness rises with the level, from {value:.4g} at none to {y[0]:.4g} at the lowest: bristles "
            "soften, so look for a spring that hardens or for noise in the input."
        )
    if error > 0.1 * abs(value):
        found.append(
            f"the standard error is {100.0 * error / abs(value):.0f} % of the value: measure at lower levels, or "
            "longer."
        )
    return tuple(found)
