"""`fisher_information`: what planned experiments will tell of each parameter, before any of them is made.

For positions measured with white noise of standard deviation s, and a free run from a known start,

    I = sum over experiments of S' S / s^2,    S = d x(t_k) / d q,    var(q_i) >= (I^-1)_ii        (Cramer-Rao)

with q the logarithms of positive parameters, and strengths of effects in their own units. S is made in forward mode.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from frictionjax.core import InputError, require_x64
from frictionjax.core.safe import real
from frictionjax.information.planned import (
    Numbers,
    for_each,
    inputs_of,
    layout_of,
    part_of,
    scale_of,
    values_of,
)
from frictionjax.physics import Drive
from frictionjax.simulation import simulate

# Directions this much weaker than their parameters alone are lost in the rounding of the matrix: their variance
# stands for infinity.
_ROUNDING, _UNBOUNDED, _LEAK = 1e-13, 1e20, 1e-6
_PRIOR = 3.0  # standard deviation of the weak prior, as that of `fit`
_NOTHING = 1e-15  # sensitivity, over the noise, of a parameter of which nothing is to be seen


def scaled_to_ones(
    matrix: Float[np.ndarray, "p p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Square roots of the diagonal of `matrix`, shape `(p,)` (1 where there is next to nothing), and it over them."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size = np.where(size > _NOTHING, size, 1.0)
    return size, matrix / size[:, None] / size[None, :]


def inverse_information(matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Inverse of an information `matrix` that may be singular, shape `(p, p)`; about 1e20 stands for infinity.

    The matrix is scaled to a diagonal of ones first: its entries span decades.
    """
    size, scaled = scaled_to_ones(matrix)
    values, vectors = np.linalg.eigh(scaled)
    lost = values < _ROUNDING * len(size)
    # A parameter apart from a lost direction has a part in it by rounding only.
    vectors = np.where(lost[None, :] & (np.abs(vectors) < _LEAK), 0.0, vectors)
    spread = np.where(lost, _UNBOUNDED, 1.0 / np.where(lost, 1.0, values))
    return (vectors * spread) @ vectors.T / np.outer(size, size)


def bounded(matrix: Float[np.ndarray, "p p"]) -> tuple[Float[np.ndarray, "p p"], Bool[np.ndarray, " p"]]:
    """The information `matrix`, with a weak prior on what is not held even when all others are known; and which it is.

    A parameter of which next to nothing is to be seen would otherwise go through e^1000000 of its value, and take
    others along that are held.
    """
    alone = np.diag(matrix) < 1.0
    return matrix + np.diag(np.where(alone, _PRIOR**-2, 0.0)), alone


class Information(eqx.Module):
    """Fisher information of experiments, about the parameter values of one drive.

    **Attributes:**

    - `names`: the `p` free parameters.
    - `units`: of each, in terms of `{force}`, `{position}`, `{input}` and `s`.
    - `logs`: whether a parameter is seen as its logarithm (positive ones), else in its own unit (strengths of effects).
    - `values`: of the parameters, in their units, shape `(p,)`.
    - `scale`: what counts as a large step of each coordinate, shape `(p,)`: 1 for a logarithm, the typical size of a
      strength in its own unit.
    - `parts`: information of each of `k` experiments alone, shape `(k, p, p)`, 1 / coordinate^2.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    logs: tuple[bool, ...] = eqx.field(static=True)
    values: Float[np.ndarray, " p"]
    scale: Float[np.ndarray, " p"]
    parts: Float[np.ndarray, "k p p"]

    @property
    def matrix(self) -> Float[np.ndarray, "p p"]:
        """Information of all experiments together, shape `(p, p)`, 1 / coordinate^2."""
        return self.parts.sum(0)

    @property
    def scaled(self) -> Float[np.ndarray, "p p"]:
        """The same for coordinates in units of `scale`, shape `(p, p)`, without unit."""
        return self.matrix * np.outer(self.scale, self.scale)

    @property
    def std(self) -> dict[str, float]:
        """Name -> least standard deviation of any unbiased estimate (Cramer-Rao).

        Relative where positive, in its own unit for a strength; `inf` where the data do not hold the parameter: where
        it would exceed the value, or the typical size of a strength. Linear theory has no digits to offer there.
        What is not held even when all others are known has a prior of 3 of these, as in `fit`, in the others' bounds.
        """
        matrix, alone = bounded(self.scaled)
        spread = np.sqrt(np.diag(inverse_information(matrix)))
        found = np.where((spread < 1.0) & ~alone, spread * self.scale, np.inf)
        return dict(zip(self.names, found.tolist(), strict=True))

    def of(self, *experiments: int) -> "Information":
        """Information of some `experiments` only, by their place in the plan."""
        return eqx.tree_at(lambda i: i.parts, self, self.parts[list(experiments)])

    def __add__(self, other: "Information") -> "Information":
        """Both plans carried out, about the same parameters of the same drive."""
        if self.names != other.names or not np.allclose(self.values, other.values, rtol=1e-12, atol=0.0):
            raise ValueError(
                f"Information about {', '.join(self.names)} and about {', '.join(other.names)} can be added only for "
                "the same parameters with the same values; use one `drive` and one `free` for both."
            )
        return eqx.tree_at(lambda i: i.parts, self, np.concatenate([self.parts, other.parts]))


def fisher_information(
    drive: Drive,
    inputs: Float[Array, " n"] | Sequence[Float[Array, " n"]],
    sample_rate: Numbers,
    noise: Numbers,
    *,
    free: Sequence[str] | None = None,
    x0: Numbers = 0.0,
    v0: Numbers = 0.0,
    z0: Numbers | None = None,
    substeps: int = 2,
) -> Information:
    """Fisher information of planned experiments on `drive`, for positions with white noise and a known start.

    I = sum over experiments of S'S / noise^2, S = dx/dq by forward-mode differentiation of `simulate`. Experiments of
    the same length share one compiled program; other numbers compile nothing anew.

    **Arguments:**

    - `drive`: the `Drive`, with the parameter values that are expected.
    - `inputs`: one planned input of shape `(n,)`, or several of any lengths, input units.
    - `sample_rate`: samples per second; one number, or one for each experiment.
    - `noise`: standard deviation of the white noise of the measured position, position units; likewise.
    - `free`: names of the parameters that are to be found; None: J, the six of LuGre and the strengths of all effects.
        `"motor_constant"` and the nuisances of effects may be named too. All others are taken as known.
    - `x0`, `v0`: known position and velocity at each start, position units and position/s.
    - `z0`: known bristle deflection at each start, position units; None: at rest none, else that of steady sliding
        at `v0`, whatever the parameters make of it.
    - `substeps`: steps per sample, see `simulate`.

    **Returns:**

    An `Information`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` when there is no input, one is not a finite array of
    shape `(n,)`, a rate or a noise is not positive, numbers and experiments are not as many, a name is unknown, a
    positive parameter is not positive, the run overflows, or no parameter changes any position.
    """
    require_x64()
    plans = inputs_of(inputs)
    count = len(plans)
    rates = for_each("sample_rate", sample_rate, count, positive=True)
    noises = for_each("noise", noise, count, positive=True)
    given = {"x0": x0, "v0": v0} | ({} if z0 is None else {"z0": z0})
    starts = [for_each(name, value, count) for name, value in given.items()]
    layout = layout_of(drive, free)
    values = values_of(layout, drive)
    parts, strokes = [], []
    for index, u in enumerate(plans):
        start = tuple(real(numbers[index]) for numbers in starts)
        found, stroke = _information(
            layout, drive, real(u), 1.0 / real(rates[index]), real(noises[index]), start, int(substeps)
        )
        if not np.all(np.isfinite(found)):
            cure = (
                "Raise `sample_rate` or `substeps`, or check the units of `drive`, the input and the start."
            )
            raise InputError(
                f"the sensitivities of experiment {index} are not finite", place="`inputs`", cure=cure
            )
        parts.append(np.asarray(found))
        strokes.append(float(stroke))
    if not np.any(parts):
        raise InputError(
            "no parameter changes any position: nothing moves in these experiments",
            place="`inputs`",
            cure="Give an input that is not zero, or a `v0`, and name parameters that act, in `free`.",
        )
    return Information(
        names=tuple(one.label for one in layout),
        units=tuple(one.parameter.unit for one in layout),
        logs=tuple(one.parameter.transform == "log" for one in layout),
        values=values,
        scale=scale_of(layout, drive, max(strokes), 1.0 / max(rates)),
        parts=np.stack(parts),
    )


@eqx.filter_jit
def _information(layout, drive, u, dt, noise, start, substeps):
    logs = np.asarray([one.parameter.transform == "log" for one in layout])
    centre = jnp.stack([part_of(drive, one.path) for one in layout])

    def run(q):
        moved = jnp.where(logs, centre * jnp.exp(jnp.where(logs, q, 0.0)), centre + q)
        machine = eqx.tree_at(lambda d: [part_of(d, one.path) for one in layout], drive, list(moved))
        x0, v0, *known = start
        z0 = known[0] if known else jnp.sign(v0) * machine.level(x0, v0) / machine.friction.sigma0
        return simulate(machine, u, 1.0 / dt, x0=x0, v0=v0, z0=z0, substeps=substeps).x

    def along(tangent):
        return jax.jvp(run, (jnp.zeros(len(layout)),), (tangent,))

    # Forward mode, all columns side by side: `linearize` would store every coefficient of the run.
    x, columns = jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(layout)))
    columns = columns / noise
    return columns @ columns.T, jnp.max(x) - jnp.min(x)
