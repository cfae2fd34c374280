"""A plant with a load and a lag of its drive: base model, models with effects beside it, rounds of the selection."""

from types import SimpleNamespace

import numpy as np
from helpers_estimation import FINE, PLANT, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.selection.decide import Step
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales

HELD_OUT = np.array([False, False, True, True])
LOAD, LAG = effect("ConstantLoad", load=0.007), effect("DriveLag", time_constant=3e-5)
SILENT = {
    "load": LOAD.silenced(),
    "lag": LAG.silenced(),
    "pendulum": effect("GravityPendulum").silenced(),
    "delay": effect("Delay").silenced(),
    "spring": effect("ReturnSpring").silenced(),
}


def world(*effects):
    """The base model and the plant's sizes, from noise in stick and moves of a plant with `effects`."""
    drive = PLANT.with_effects(*effects)
    recordings = []
    for seed in (1, 3):
        role = "fit" if seed == 1 else "holdout"
        recordings.append(open_loop("stick", stick_noise(1.2, seed=seed), seed=seed, drive=drive, role=role))
        recordings.append(open_loop("moves", pushes(seed), seed=seed + 1, drive=drive, role=role))
    batch = make_batch(tuple(recordings), encoder_step=FINE)
    joint, vector = robust_posterior(PLANT, batch, HELD_OUT)
    return converged(joint.at_bandwidth(SLOW_BANDWIDTH), vector), plant_scales(PLANT, batch)


def pushes(seed):
    """Torque that drives the plant to and fro through break-away."""
    t = np.arange(8000) / 2000.0
    return 1.6 * np.sin(2 * np.pi * (2.0 + 0.3 * seed) * t) + 0.4 * np.sin(2 * np.pi * 7.0 * t)


def converged(joint, vector):
    fitted = descend(joint, vector, graduate=False)
    return Model(joint, fitted, judge(joint, fitted))


def with_effect(model, name, scales):
    return converged(*extend(model.joint, model.fitted.vector, SILENT[name], scales))


def a_round(before, after, name, p_value=1e-9):
    """A round that tried one effect and accepted it."""
    form = SILENT[name]
    trial = SimpleNamespace(effect=form.name, form=form, p_value=p_value)
    refitted = Refitted(trial, after)
    floor = np.ones_like(before.judgement.power)
    compared = compare(before.judgement, after.judgement, floor)
    return Step(before, [trial], [refitted], [compared], floor, 0.0, refitted, ())
