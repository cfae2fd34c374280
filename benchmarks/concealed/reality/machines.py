"""Machines of the industrial, laboratory, poor and joint families: each drawn as such machines are built."""

from __future__ import annotations

import dataclasses

import numpy as np

from .plants import PROCESS_NOISE, Plant, draw_plant, log_uniform

Rng = np.random.Generator


def _coarse_step(rng: Rng, rotary: bool) -> float:
    """Step of an encoder with 2,000 to 10,000 counts a turn; of a belt axis, as many a turn of its pulley."""
    counts = log_uniform(rng, 2000.0, 10000.0)
    return (2 * np.pi if rotary else log_uniform(rng, 0.04, 0.2)) / counts


def _input(rng: Rng, plant: Plant) -> dict:
    """What the drive records: the force itself, or the current."""
    if rng.random() < 0.4:
        return {"motor_constant": 1.0, "input_unit": plant.units["force_unit"]}
    # A current of some amperes makes the largest force.
    return {"motor_constant": plant.Fs / log_uniform(rng, 0.3, 3.0), "input_unit": "A"}


def industrial(rng: Rng, kind: str | None) -> Plant:
    """A servo axis with a coarse encoder: several turns, or some tenths of a metre."""
    plant = draw_plant(rng, kind)
    rotary = plant.kind == "rotary"
    stroke = log_uniform(rng, 1.5, 12.0) if rotary else log_uniform(rng, 0.1, 0.6)
    acceleration = rng.uniform(1.5, 4.0) * plant.Fs / plant.J
    # As fast as a third to the whole of what acceleration and stroke allow.
    top = float(np.sqrt(stroke * acceleration)) * rng.uniform(0.35, 1.0)
    return dataclasses.replace(
        plant,
        stroke=stroke,
        top_speed=top,
        acceleration=acceleration,
        vs=log_uniform(rng, 0.01, 0.05) * top,
        sigma2=log_uniform(rng, 0.05, 0.5) * plant.Fc / top,
        encoder_step=_coarse_step(rng, rotary),
        sensor_noise=rng.uniform(0.02, 0.15),
        **_input(rng, plant),
    )


def laboratory(rng: Rng, kind: str | None) -> Plant:
    """A test bench with a fine encoder."""
    plant = draw_plant(rng, kind)
    step = plant.deflection / log_uniform(rng, 1000.0, 10000.0)
    return dataclasses.replace(
        plant,
        encoder_step=step,
        acceleration=rng.uniform(2.0, 4.0) * plant.Fs / plant.J,
        **_input(rng, plant),
    )


def poor(rng: Rng, kind: str | None) -> Plant:
    """A machine whose encoder is between fine and coarse."""
    plant = draw_plant(rng, kind)
    fine, coarse = plant.encoder_step, _coarse_step(rng, plant.kind == "rotary")
    step = fine * (coarse / fine) ** rng.uniform(0.3, 0.9)
    return dataclasses.replace(
        plant,
        encoder_step=step,
        sensor_noise=rng.uniform(0.05, 0.5),
        acceleration=rng.uniform(2.0, 4.0) * plant.Fs / plant.J,
        **_input(rng, plant),
    )


def joint(rng: Rng, kind: str | None) -> Plant:
    """A robot's joint with a link on it: its weight is half to twenty times Coulomb friction.

    Raises ValueError for a linear machine: a joint turns.
    """
    if kind == "linear":
        raise ValueError("a joint is a rotary machine; leave out kind, or ask for another family")
    J = log_uniform(rng, 0.005, 0.5)
    # Weight over inertia is g / l for a mass at the distance l; the motor's own inertia lowers it.
    gravity = J * log_uniform(rng, 8.0, 60.0)
    Fc = gravity / log_uniform(rng, 0.5, 20.0)
    Fs = Fc * rng.uniform(1.05, 1.5)
    natural = 2 * np.pi * log_uniform(rng, 8.0, 40.0)
    stroke = rng.uniform(0.6, 1.4)
    top = stroke * log_uniform(rng, 1.2, 4.0)
    plant = Plant(
        kind="rotary",
        J=J,
        sigma0=J * natural**2,
        sigma1=2 * log_uniform(rng, 0.2, 0.8) * J * natural,
        sigma2=log_uniform(rng, 0.1, 1.0) * Fc / top,
        Fc=Fc,
        Fs=Fs,
        vs=log_uniform(rng, 0.02, 0.1) * top,
        motor_constant=1.0,
        encoder_step=2 * np.pi / float(2 ** rng.integers(12, 17)),
        sensor_noise=rng.uniform(0.02, 0.5),
        process_noise=float(rng.choice(PROCESS_NOISE)),
        stroke=stroke,
        top_speed=top,
        acceleration=top / rng.uniform(0.2, 0.5),
        gravity=gravity,
        gravity_at=rng.uniform(-np.pi, np.pi),
    )
    return dataclasses.replace(plant, **_input(rng, plant))


MACHINES = {machine.__name__: machine for machine in (industrial, laboratory, poor, joint)}
"""Family -> what draws its machines, from a random stream and the kind that is forced (None: either)."""
