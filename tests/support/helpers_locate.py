"""A made-up motion, what the base model saw of it, and innovations of a true model along it."""

import numpy as np
from helpers_estimation import FINE, PLANT, RATE

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.views import View
from frictionjax.diagnosis.mismatch_map.axes import EstimatedMotion, axes_of
from frictionjax.diagnosis.mismatch_map.bin_power import tally_of
from frictionjax.diagnosis.mismatch_map.frequency_bands import bands_of
from frictionjax.diagnosis.mismatch_map.locate import floor_of_samples, grid_of
from frictionjax.diagnosis.mismatch_map.null_maps import chance_of, draw_innovations
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch
from frictionjax.recordings import Plant, Recording

UNITS = Plant(motor_constant=16.0, position_unit="rad", force_unit="N*m", input_unit="V")
RESTS = (0.05, 0.2, 0.6, 1.5)
"""Rests between the moves of `moves`, s."""
_MOVE = 0.25  # s
_STROKE = 0.05  # rad


class World:
    """Recordings, the base model's view of them, the axes, and what chance makes of their map."""

    def __init__(self, x, v, bend, u):
        noise = 1e-6 * np.random.default_rng(1).standard_normal(x.shape)
        names = ("one", "two")
        recordings = tuple(
            Recording(name, RATE, push, place + wiggle)
            for name, push, place, wiggle in zip(names, u, x, noise, strict=True)
        )
        batch = make_batch(recordings, encoder_step=FINE)
        pad = ((0, 0), (0, np.asarray(batch.x).shape[1] - x.shape[1]))
        self.scene = Scene(batch, np.array([False, True]), np.full(2, 50.0), names)
        self.motion = EstimatedMotion(*(np.pad(values, pad, mode="edge") for values in (x, v, bend, u)))
        self.axes = axes_of(self.motion, PLANT, UNITS, self.scene)
        self.t = np.arange(self.motion.x.shape[1]) / RATE
        self.chance = self.chance_above(None)

    def chance_above(self, floor):
        level = floor_of_samples(floor, self.scene)
        return chance_of(
            tally_of(self.axes, self.scene, Rule()), bands_of(self.scene, level), self.scene, level
        )

    def innovations(self, seed, floor=None):
        """Standardised innovations of a true model, shape `(r, n)`."""
        level = floor_of_samples(floor, self.scene)
        drawn = draw_innovations(self.scene, level, 1, np.random.default_rng(seed))[0]
        return drawn.astype(float) * np.sqrt(level)

    def located(self, e, after=None, *, floor=None, chance=None):
        return self.grid(floor, chance).located(*views_of(e, e if after is None else after))

    def grid(self, floor=None, chance=None):
        return grid_of(self.axes, self.scene, floor, chance or self.chance)

    def planted(self, where, size=8.0, seed=0):
        """The map of a true model's innovations with another such noise, `size` times as large, `where` it acts."""
        return self.located(self.innovations(seed) + size * where * self.innovations(seed + 1))


def views_of(*innovations):
    """Views of which the map uses the `innovations` alone."""
    return [View(own, own, own, own, own, own) for own in innovations]


def swings():
    """Two swings of 8 s, 0.2 rad wide, with a bristle that is bent in every way in turn."""
    t = np.arange(16000) / RATE
    phases = [2.0 * np.pi * frequency * t for frequency in (0.5, 0.8)]
    x = np.stack([0.2 * np.sin(phase) for phase in phases])
    v = np.stack([0.4 * np.pi * f * np.cos(phase) for f, phase in zip((0.5, 0.8), phases, strict=True)])
    bend = np.stack([np.abs(np.sin(2.0 * np.pi * 0.37 * t)), np.ones(t.size)])
    u = np.stack([0.05 * np.sin(2.0 * np.pi * 0.11 * t), 0.02 * np.cos(2.0 * np.pi * 0.23 * t)])
    return World(x, v, bend, u)


def moves():
    """Moves to and fro with rests of `RESTS` between them in a mixed order, two recordings of 30 s, no two alike; and
    for each sample the time since its motion began (s, infinite at rest) and the rest before it (s)."""
    rng = np.random.default_rng(8)
    count = round(30.0 * RATE)
    x, v = np.zeros((2, count)), np.zeros((2, count))
    age, rest = np.full((2, count), np.inf), np.zeros((2, count))
    n = round(_MOVE * RATE)
    s = np.arange(n) / n
    shape, speed = s**2 * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) / _MOVE
    u = np.zeros((2, count))
    for row in range(2):
        k, place, sign = 0, 0.0, 1.0
        while True:
            wait = float(rng.choice(RESTS))
            start = k + round(wait * RATE)
            if start + n > count:
                x[row, k:] = place
                break
            way = sign * rng.uniform(0.0, _STROKE) - place  # to another place on the other side
            x[row, k:start], x[row, start : start + n] = place, place + way * shape
            v[row, start : start + n], u[row, k : start + n] = way * speed, rng.uniform(-0.03, 0.03)
            age[row, start : start + n], rest[row, start : start + n] = np.arange(n) / RATE, wait
            place, sign, k = place + way, -sign, start + n
    bend = np.where(np.abs(v) > 0.0, 1.0, 0.1)
    world = World(x, v, bend, u)
    pad = ((0, 0), (0, world.t.size - count))
    return world, np.pad(age, pad, constant_values=np.inf), np.pad(rest, pad)
