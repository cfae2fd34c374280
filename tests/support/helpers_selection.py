"""A plant with a load and a lag of its drive: base model, models with effects beside it, rounds of the selection.

What one test has fitted is there for the others of its process: nobody changes a model.
"""

import functools
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
from helpers_estimation import FINE, PLANT, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.answers import Answers
from frictionjax.diagnosis.selection.candidate_table import Ground
from frictionjax.diagnosis.selection.refitted_tables import Made, RefittedTables
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Search
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales

HELD_OUT = np.array([False, False, True, True])
LOAD, LAG = effect("ConstantLoad", load=0.007), effect("DriveLag", time_constant=3e-5)
PLANTED = {"load": LOAD, "lag": LAG}
SILENT = {
    "load": LOAD.silenced(),
    "lag": LAG.silenced(),
    "pendulum": effect("GravityPendulum").silenced(),
    "delay": effect("Delay").silenced(),
    "spring": effect("ReturnSpring").silenced(),
}


@functools.cache
def world(*names):
    """The base model and the plant's sizes, from noise in stick and moves of a plant with the effects `names`."""
    drive = PLANT.with_effects(*(PLANTED[name] for name in names))
    recordings = []
    for seed in (1, 3):
        role = "fit" if seed == 1 else "holdout"
        recordings.append(open_loop("stick", stick_noise(1.2, seed=seed), seed=seed, drive=drive, role=role))
        recordings.append(open_loop("moves", pushes(seed), seed=seed + 1, drive=drive, role=role))
    batch = make_batch(tuple(recordings), encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, batch, HELD_OUT)
    return converged(posterior.at_bandwidth(SLOW_BANDWIDTH), vector), plant_scales(PLANT, batch)


def pushes(seed):
    """Torque that drives the plant to and fro through break-away."""
    t = np.arange(8000) / 2000.0
    return 1.6 * np.sin(2 * np.pi * (2.0 + 0.3 * seed) * t) + 0.4 * np.sin(2 * np.pi * 7.0 * t)


def converged(posterior, vector):
    fitted = descend(posterior, vector, graduate=False)
    return Model(posterior, fitted, judge(posterior, fitted))


_FITTED = {}


def with_effect(model, name, scales):
    """The `model` and one effect more, fitted."""
    key = id(model), name
    if key not in _FITTED:
        fitted = converged(*extend(model.posterior, model.fitted.vector, SILENT[name], scales))
        _FITTED[key] = model, fitted  # while the model is kept no other one has its identity
    return _FITTED[key][1]


def refitted(after, name, p_value=1e-9):
    """The candidate of this name, whose refit is the model `after`."""
    form = SILENT[name]
    trial = SimpleNamespace(effect=form.name, form=form, p_value=p_value, gain=1.0, linear_gain=1.0)
    return Refitted(trial, after)


class Bench:
    """Tables of the models of one world; `known` are the effects that it can refit beside others, and `asked` the names
    for which it was."""

    def __init__(self, base, scales, known=()):
        self.scales, self.known, self.asked = scales, known, []
        with ThreadPoolExecutor(1) as executor:
            answers = Answers(base, executor)
        self.tables = RefittedTables(base, self, scales, answers.of_likeliest)
        self.search = Search(self.tables, Rule(), 3)
        self._base = base

    def related(self, model, names, best=None):
        self.asked.append(names)
        known = [key for key in self.known if SILENT[key].name in names]
        found = [refitted(with_effect(model, key, self.scales), key) for key in known]
        return [refit.trial for refit in found], found

    def a_round(self, before, after, name):
        """A round that tried one effect and accepted it."""
        found, floor = refitted(after, name), np.ones_like(before.judgement.power)
        made = Made(before, [found.trial], [found], Ground(floor, 0.0, False))
        return Round(self.tables.keep((name, str(len(self.tables.tables))), made), 0)

    def chain(self, *names):
        """Rounds in which effects of these `names` were accepted one after the other."""
        chain, before = [], self._base
        for name in names:
            chain.append(self.a_round(before, with_effect(before, name, self.scales), name))
            before = self.model(chain[-1])
        return chain

    def model(self, found):
        """The model that the round `found` accepted."""
        return self.tables.accepted(found).model
