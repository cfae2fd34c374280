"""The 27 models of the nonlinear regression problems, as the headers of their files write them: the response at the
predictors `x`, shape `(k, n)`, with parameters `b`, shape `(p,)`."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

Model = Callable[[Float[Array, " p"], Float[Array, "k n"]], Float[Array, " n"]]


def _bennett5(b, x):
    return b[0] * (b[1] + x[0]) ** (-1.0 / b[2])


def _saturation(b, x):
    return b[0] * (1.0 - jnp.exp(-b[1] * x[0]))


def _chwirut(b, x):
    return jnp.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


def _power(b, x):
    return b[0] * x[0] ** b[1]


def _enso(b, x):
    def wave(cosine, sine, period):
        angle = 2.0 * jnp.pi * x[0] / period
        return cosine * jnp.cos(angle) + sine * jnp.sin(angle)

    return b[0] + wave(b[1], b[2], 12.0) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


def _eckerle4(b, x):
    return b[0] / b[1] * jnp.exp(-0.5 * ((x[0] - b[2]) / b[1]) ** 2)


def _gauss(b, x):
    peaks = (b[k] * jnp.exp(-((x[0] - b[k + 1]) ** 2) / b[k + 2] ** 2) for k in (2, 5))
    return b[0] * jnp.exp(-b[1] * x[0]) + sum(peaks)


def _cubic_over_cubic(b, x):
    above = b[0] + b[1] * x[0] + b[2] * x[0] ** 2 + b[3] * x[0] ** 3
    return above / (1.0 + b[4] * x[0] + b[5] * x[0] ** 2 + b[6] * x[0] ** 3)


def _kirby2(b, x):
    return (b[0] + b[1] * x[0] + b[2] * x[0] ** 2) / (1.0 + b[3] * x[0] + b[4] * x[0] ** 2)


def _lanczos(b, x):
    return sum(b[k] * jnp.exp(-b[k + 1] * x[0]) for k in (0, 2, 4))


def _mgh09(b, x):
    return b[0] * (x[0] ** 2 + x[0] * b[1]) / (x[0] ** 2 + x[0] * b[2] + b[3])


def _mgh10(b, x):
    return b[0] * jnp.exp(b[1] / (x[0] + b[2]))


def _mgh17(b, x):
    return b[0] + b[1] * jnp.exp(-x[0] * b[3]) + b[2] * jnp.exp(-x[0] * b[4])


def _misra1b(b, x):
    return b[0] * (1.0 - (1.0 + b[1] * x[0] / 2.0) ** -2)


def _misra1c(b, x):
    return b[0] * (1.0 - (1.0 + 2.0 * b[1] * x[0]) ** -0.5)


def _misra1d(b, x):
    return b[0] * b[1] * x[0] / (1.0 + b[1] * x[0])


def _nelson(b, x):
    return b[0] - b[1] * x[0] * jnp.exp(-b[2] * x[1])


def _rat42(b, x):
    return b[0] / (1.0 + jnp.exp(b[1] - b[2] * x[0]))


def _rat43(b, x):
    return b[0] / (1.0 + jnp.exp(b[1] - b[2] * x[0])) ** (1.0 / b[3])


def _roszman1(b, x):
    return b[0] - b[1] * x[0] - jnp.arctan(b[2] / (x[0] - b[3])) / jnp.pi


MODELS: dict[str, Model] = {
    "Bennett5": _bennett5,
    "BoxBOD": _saturation,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": _power,
    "ENSO": _enso,
    "Eckerle4": _eckerle4,
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubic_over_cubic,
    "Kirby2": _kirby2,
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": _mgh09,
    "MGH10": _mgh10,
    "MGH17": _mgh17,
    "Misra1a": _saturation,
    "Misra1b": _misra1b,
    "Misra1c": _misra1c,
    "Misra1d": _misra1d,
    "Nelson": _nelson,
    "Rat42": _rat42,
    "Rat43": _rat43,
    "Roszman1": _roszman1,
    "Thurber": _cubic_over_cubic,
}
"""Name of a problem -> its model."""

LOGARITHM = frozenset({"Nelson"})
"""Problems whose model is that of the logarithm of the response."""
