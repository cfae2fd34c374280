"""The force that a model needs beside it: in force units, and against friction and the applied force."""

import numpy as np

from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.recording_fit import Unmeasured


def unmeasured_force(model: Model, of_coulomb: float) -> Unmeasured:
    """The force, `of_coulomb` friction (root mean square), that the `model` needs beside it, against the one that was
    applied or, under an imposed motion, measured."""
    batch, drive = model.posterior.batch, model.judgement.drive
    scored = np.asarray(batch.valid) > 0
    if batch.inputs is None:
        applied = np.asarray(batch.answer)[scored]
    else:
        applied = float(drive.motor_constant) * np.asarray(batch.inputs)[scored]
    force = of_coulomb * float(drive.friction.Fc)
    return Unmeasured(force, of_coulomb, force / max(float(np.sqrt(np.mean(applied**2))), 1e-300))
