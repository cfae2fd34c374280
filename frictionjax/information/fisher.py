"""`fisher_information`: the information of planned experiments about each parameter, before any of them is made.

For positions measured with white noise of standard deviation s, and a free run from a known start,

    I = sum over experiments of S' S / s^2,    S = d x(t_k) / d q,    var(q_i) >= (I^-1)_ii        (Cramer-Rao)

with q the logarithms of positive parameters, and strengths of effects in their own units. S comes from forward mode.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from frictionjax.core import InputError, require_x64
from frictionjax.core.safe import real
from frictionjax.estimation.parameters import Free, part_of
from frictionjax.information.planned import (
    Inputs,
    Numbers,
    Plan,
    Start,
    layout_of,
    plan_of,
    scale_of,
    values_of,
)
from frictionjax.physics import Drive
from frictionjax.simulation import simulate

# Directions this much weaker than their parameters alone are rounding errors of the matrix: their variance is set to
# a number that stands for infinity.
_ROUNDING, _UNBOUNDED, _LEAK = 1e-13, 1e20, 1e-6
PRIOR = 3.0
"""Standard deviation of the weak prior, in units of a large step of each coordinate, as that of `fit`."""
_NOTHING = 1e-15  # sensitivity, over the noise, of a parameter without any effect on the positions


def scaled_to_ones(
    matrix: Float[np.ndarray, "p p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Square roots of the diagonal of `matrix`, shape `(p,)` (1 where about zero), and the matrix scaled by them."""
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
    # Small components of a lost direction are rounding errors.
    vectors = np.where(lost[None, :] & (np.abs(vectors) < _LEAK), 0.0, vectors)
    spread = np.where(lost, _UNBOUNDED, 1.0 / np.where(lost, 1.0, values))
    return (vectors * spread) @ vectors.T / np.outer(size, size)


def bounded(matrix: Float[np.ndarray, "p p"]) -> tuple[Float[np.ndarray, "p p"], Bool[np.ndarray, " p"]]:
    """The information `matrix`, with a weak prior on parameters that are unidentifiable alone; and which those are.

    Alone means with all others known. Without the prior, such a parameter would change by e^1000000 of its value, and
    make identifiable parameters seem unidentifiable.
    """
    alone = np.diag(matrix) < 1.0
    return matrix + np.diag(np.where(alone, PRIOR**-2, 0.0)), alone


class Information(eqx.Module):
    """Fisher information of experiments, about the parameter values of one drive.

    **Attributes:**

    - `names`: the `p` free parameters.
    - `units`: of each, in terms of `{force}`, `{position}`, `{input}` and `s`.
    - `logs`: whether the coordinate is the logarithm (positive parameters), else the parameter itself (strengths).
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

        Relative where positive, in its own unit for a strength; `inf` where the data do not determine the parameter:
        where it would exceed the value, or the typical size of a strength, and linear theory is not valid.
        A parameter that is unidentifiable even with all others known has a prior of 3 of these, as in `fit`, in the
        others' bounds.
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
    inputs: Inputs,
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
    - `free`: names of the free parameters; None: J, the six of LuGre and the strengths of all effects.
        `"motor_constant"` and the nuisances of effects may be named too. All others are taken as known.
    - `x0`, `v0`: known position and velocity at each start, position units and position/s.
    - `z0`: known bristle deflection at each start, position units; None: zero at rest, else that of steady sliding
        at `v0`, which depends on the parameters.
    - `substeps`: steps per sample, see `simulate`.

    **Returns:**

    An `Information`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` when there is no input, one is not a finite array of
    shape `(n,)`, a rate or a noise is not positive, numbers and experiments differ in count, a name is unknown, a
    positive parameter is not positive, the run overflows, or no parameter changes any position.
    """
    require_x64()
    plan = plan_of(inputs, sample_rate, noise, x0=x0, v0=v0, z0=z0, substeps=substeps)
    layout = layout_of(drive, free)
    values_of(layout, drive)
    return assembled(layout, drive, plan, list(planned_records(layout, drive, plan)))


class PlannedRecord(NamedTuple):
    """The information of one record of a plan: the `matrix`, shape `(p, p)`; `root`, with `root' root` that matrix,
    with twice the digits; the `stroke`, and the largest |x| and |v| of the run (`peak_x`, `peak_v`)."""

    matrix: Float[np.ndarray, "p p"]
    root: Float[np.ndarray, "p p"]
    stroke: float
    peak_x: float
    peak_v: float

    def finite(self, label: str) -> "PlannedRecord":
        """This record, unless its run overflows; `label` names it in the error."""
        if np.all(np.isfinite(self.root)) and np.all(np.isfinite(self.matrix)):
            return self
        cure = "Raise `sample_rate` or `substeps`, or check the units of `drive`, the input and the start."
        raise InputError(f"the sensitivities of {label} are not finite", place="`inputs`", cure=cure)


def planned_records(layout: tuple[Free, ...], drive: Drive, plan: Plan) -> Iterator[PlannedRecord]:
    """The records of `plan` on `drive`, one after the other, about the parameters of `layout`; some may overflow."""
    for index, u in enumerate(plan.inputs):
        dt, noise = 1.0 / real(plan.rates[index]), real(plan.noises[index])
        found = _information(layout, drive, real(u), dt, noise, plan.starts[index], plan.substeps)
        matrix, root, *peaks = (np.asarray(part) for part in found)
        yield PlannedRecord(matrix, root, *(float(peak) for peak in peaks))


def assembled(
    layout: tuple[Free, ...], drive: Drive, plan: Plan, records: Sequence[PlannedRecord]
) -> Information:
    """The `Information` of all `records` of `plan` on `drive`, about the parameters of `layout`."""
    parts = [one.finite(label).matrix for one, label in zip(records, plan.labels, strict=True)]
    if not np.any(parts):
        raise InputError(
            "no parameter changes any position: the machine does not move in these experiments",
            place="`inputs`",
            cure="Give an input that is not zero, or a `v0`, and name parameters with an effect in `free`.",
        )
    return Information(
        names=tuple(one.label for one in layout),
        units=tuple(one.parameter.unit for one in layout),
        logs=tuple(one.parameter.transform == "log" for one in layout),
        values=values_of(layout, drive),
        scale=scale_of(layout, drive, max(one.stroke for one in records), 1.0 / max(plan.rates)),
        parts=np.stack(parts),
    )


def sensitivities(
    layout: tuple[Free, ...],
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    start: Start,
    substeps: int,
    q: Float[Array, " p"] | None = None,
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, "p n"]]:
    """Positions and velocities of a free run, shape `(n,)`, and dx/dq, shape `(p, n)`; to be called inside `jit`.

    **Arguments:**

    - `layout`: the `p` free parameters.
    - `drive`: the values that stand for q = 0.
    - `u`: the input, shape `(n,)`, input units, held for `dt` s each.
    - `start`: x0, v0 and, if known, z0.
    - `substeps`: steps per sample.
    - `q`: logarithms of positive parameters over their values, changes of strengths, shape `(p,)`; None: zero.
    """
    logs = np.asarray([one.parameter.transform == "log" for one in layout])
    centre = jnp.stack([real(part_of(drive, one.path)) for one in layout])
    q = jnp.zeros(len(layout)) if q is None else q

    def run(q: Float[Array, " p"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        moved = jnp.where(logs, centre * jnp.exp(jnp.where(logs, q, 0.0)), centre + q)
        machine = eqx.tree_at(lambda d: [part_of(d, one.path) for one in layout], drive, list(moved))
        x0, v0, *known = start
        z0 = known[0] if known else jnp.sign(v0) * machine.level(x0, v0) / machine.friction.sigma0
        rate: Any = 1.0 / dt  # traced, where `simulate` says a float
        found = simulate(machine, u, rate, x0=x0, v0=v0, z0=z0, substeps=substeps)
        return found.measured, found.v

    def along(
        tangent: Float[Array, " p"],
    ) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
        x, change, v = jax.jvp(run, (q,), (tangent,), has_aux=True)
        return x, v, change

    # Forward mode, all columns in one batch: `linearize` would store every coefficient of the run.
    return jax.vmap(along, out_axes=(None, None, 0))(jnp.eye(len(layout)))


@eqx.filter_jit
def _information(
    layout: tuple[Free, ...],
    drive: Drive,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    noise: Float[Array, ""],
    start: Start,
    substeps: int,
) -> tuple[Float[Array, "p p"], Float[Array, "p p"], Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    x, v, columns = sensitivities(layout, drive, u, dt, start, substeps)
    columns = columns / noise
    # The triangle of a QR keeps digits that squaring loses; QR needs at least as many rows as columns.
    rows = jnp.concatenate([columns.T, jnp.zeros((len(layout), len(layout)))])
    root = jnp.linalg.qr(rows, mode="r")
    stroke = jnp.max(x) - jnp.min(x)
    return columns @ columns.T, root, stroke, jnp.max(jnp.abs(x)), jnp.max(jnp.abs(v))
