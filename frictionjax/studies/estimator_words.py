"""Three sentences on which estimator to use when, made from the numbers of the comparison."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Findings(NamedTuple):
    """The numbers behind the sentences, with the axes estimator (SK, ML, break-away, joint), noise level, parameter.

    **Attributes:**

    - `noise`: of the position over the deflection at break-away, shape `(k,)`.
    - `bias`, `std`, `bound`: over the true value, shape `(4, k, 7)`.
    - `coverage`: of the 95 % interval, shape `(4, k, 7)`.
    - `converged`: part of the draws, shape `(4, k)`.
    - `milliseconds`: for one draw, shape `(4,)`.
    - `excitation`: rms of the noise experiment over break-away.
    """

    noise: Float[np.ndarray, " k"]
    bias: Float[np.ndarray, "4 k p"]
    std: Float[np.ndarray, "4 k p"]
    bound: Float[np.ndarray, "4 k p"]
    coverage: Float[np.ndarray, "4 k p"]
    converged: Float[np.ndarray, "4 k"]
    milliseconds: Float[np.ndarray, " 4"]
    excitation: float


def sentences(found: Findings) -> tuple[str, str, str]:
    """One sentence on the frequency response, one on break-away data, one on both together, from `found`."""
    return _response(found), _breakaway(found), _joint(found)


def _percent(value: float) -> str:
    percent = 100.0 * value
    return f"{percent:.0f} %" if abs(percent) >= 10.0 else f"{percent:.2g} %"


def _range(values: Float[np.ndarray, "..."], form: str) -> str:
    low, high = (format(value, form) for value in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"{low} to {high}"


def _response(found: Findings) -> str:
    rms = np.hypot(found.bias, found.std)[:2, :, :3]
    ratio = np.max(rms[0], axis=1) / np.max(rms[1], axis=1)
    loud, quiet = int(np.argmax(found.noise)), int(np.argmin(found.noise))
    low = found.bias[1, quiet, 1]
    side = "low" if low < 0.0 else "high"
    worst = int(np.argmax(np.abs(found.bias[0, loud, :3])))
    name = ("J", "sigma0", "sigma1 + sigma2")[worst]
    advice = (
        "prefer maximum likelihood to Sanathanan-Koerner"
        if np.max(ratio) > 1.1 and np.min(ratio) > 0.9
        else "note that maximum likelihood is not clearly better than Sanathanan-Koerner"
    )
    return (
        f"Use a frequency response when no friction model is to be assumed and no start is known, and {advice} (at a "
        f"noise of {_percent(found.noise[loud])} of the break-away deflection the bias of {name} is "
        f"{_percent(found.bias[0, loud, worst])} against {_percent(found.bias[1, loud, worst])}, at "
        f"{found.milliseconds[1]:.2g} ms a draw for both); but friction is not linear, and at "
        f"{_percent(found.excitation)} of break-away sigma0 comes out {_percent(abs(low))} too {side} however "
        f"little noise there is, and its 95 % interval then covers the truth in "
        f"{_percent(found.coverage[1, quiet, 1])} "
        "of the draws: extrapolate to zero amplitude."
    )


def _breakaway(found: Findings) -> str:
    return (
        "Use break-away data with the full LuGre model for Fc, Fs, vs and sigma2, which no response below break-away "
        f"determines, and for sigma0: over all noise levels the scatter is "
        f"{_range(found.std[2] / found.bound[2], '.2f')} "
        "times the Cramer-Rao bound and the 95 % interval covers the truth in "
        f"{_range(100.0 * found.coverage[2], '.0f')} % of the draws, at {found.milliseconds[2]:.2g} ms a draw; but "
        "friction must be LuGre, and a start known "
        f"(within 10 % here: {_range(100.0 * found.converged[2], '.0f')} % of the draws converge)."
    )


def _joint(found: Findings) -> str:
    gain = np.nanmean(found.std[2] / found.std[3], axis=0)
    use = (
        "Use all data jointly when presliding matters"
        if max(gain[1], gain[2]) > 1.1
        else "Using all data jointly gains too little for its time"
    )
    return (
        f"{use}: against break-away alone the scatter falls by a factor of {gain[2]:.2f} for sigma1 + sigma2, "
        f"{gain[1]:.2f} for sigma0 and {gain[0]:.2f} for J, for {found.milliseconds[3]:.2g} ms a draw instead of "
        f"{found.milliseconds[2]:.2g}, at {_range(found.std[3] / found.bound[3], '.2f')} times its bound."
    )
