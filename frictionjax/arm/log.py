"""A log of an arm: positions and torques of all its joints on one clock."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core.display import SIGNALS, AbstractDisplayed, Display, TextGrid, signal_row


class ArmLog(AbstractDisplayed):
    """One uniformly sampled log of all joints of an arm.

    **Attributes:**

    - `name`: of the log, unique among those of one arm (the file's stem).
    - `sample_rate`: samples per second.
    - `q`: measured positions, shape `(n, j)`, rad of hinges and m of slides.
    - `tau`: torques of the motors at the joints, shape `(n, j)`, N m of hinges and N of slides.
    - `joints`: names of the joints in the model, in the order of the columns; empty: all hinges and slides of the
        model, in its order.
    - `role`: `"fit"`, or `"holdout"`: judges the result, and is not fitted.
    - `start_time`: s since power-on; logs of one warm-up share a clock.
    - `warnings`: what was found in the columns of each joint, as sentences; empty: nothing.
    """

    name: str = eqx.field(static=True)
    sample_rate: float = eqx.field(static=True)
    q: Float[np.ndarray, "n j"]
    tau: Float[np.ndarray, "n j"]
    joints: tuple[str, ...] = eqx.field(static=True, default=())
    role: Literal["fit", "holdout"] = eqx.field(static=True, default="fit")
    start_time: float = eqx.field(static=True, default=0.0)
    warnings: tuple[tuple[str, ...], ...] = eqx.field(static=True, default=())

    def _display(self) -> Display:
        role = "held out" if self.role == "holdout" else "to fit"
        n, count = self.q.shape
        title = f"ArmLog {self.name}: {count} joints, {n} samples at {self.sample_rate:g} Hz, {role}"
        names = self.joints or tuple(str(k + 1) for k in range(count))
        rows = [signal_row(f"q of {name}", self.q[:, k], "") for k, name in enumerate(names)]
        rows += [signal_row(f"tau of {name}", self.tau[:, k], "") for k, name in enumerate(names)]
        said = dict.fromkeys(sentence for joint in self.warnings for sentence in joint)
        return Display(title, tuple(said), (TextGrid(SIGNALS, tuple(rows)),))
