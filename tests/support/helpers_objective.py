"""The cost of the innovations of one structure under any loss: what the solver of `fit` is tested on."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.objective.loss import AbstractLoss
from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic, quadratic_of
from frictionjax.estimation.objective.setting import Setting, all_columns, compact_jacobian
from frictionjax.estimation.parameters import Free


class Innovations(AbstractObjective):
    """The innovations of `layout` and `setting` (as in `predicted_errors`) under a `loss`, with the weak prior."""

    layout: tuple[Free, ...]
    setting: Setting
    loss: AbstractLoss

    def quadratic(self, vector: Float[Array, " q"]) -> Quadratic:
        setting, batch = self.setting, self.setting.batch
        e, compact = compact_jacobian(self.layout, vector, setting)
        columns = all_columns(compact)
        blocks = quadratic_of(
            e.reshape(-1, batch.block),
            columns.reshape(columns.shape[0], -1, batch.block),
            batch.block_count.ravel(),
            self.loss,
            jnp.ones(batch.block_count.size),
        )
        off = (vector - setting.start) * setting.prior
        return blocks + Quadratic(0.5 * off @ off, off * setting.prior, jnp.diag(setting.prior**2))
