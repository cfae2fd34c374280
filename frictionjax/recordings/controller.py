"""The user's own controller, with which a free run of a model is closed-loop, as on the machine."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core.display import one_line
from frictionjax.core.safe import real


class Controller(eqx.Module):
    """A P, PI, PD or PID controller of the position: u = feedforward + kp e + ki integral(e) + kd de/dt, where e is the
    reference less the measured position; u stays within its limit, and is held between its samples.

    **Attributes:**

    - `kp`, `ki`, `kd`: gains, input unit per position unit; that per s; and times s.
    - `limit`: largest |u|, input units; infinite: none.
    - `rate`: its samples per second; None: those of the recording.
    """

    kp: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    ki: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    kd: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    limit: Float[Array, "..."] = eqx.field(converter=real, default=float("inf"))
    rate: float | None = eqx.field(static=True, default=None)

    def __repr__(self) -> str:
        return one_line(self, *(() if np.all(np.isfinite(self.limit)) else ("limit",)))
