"""Counting what JAX traces and compiles, and short recordings that a fit goes through in seconds."""

import os
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis
from helpers_estimation import PLANT, break_away, large_noise
from helpers_plants import effect
from helpers_studies import kept_study

import frictionjax.api as api
from frictionjax.information import Information
from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Recording
from frictionjax.report import save_diagnosis
from frictionjax.simulation import simulate

_EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "traced",
    "/jax/core/compile/backend_compile_duration": "compiled",
}
_log: list[str] = []


def _note(event: str, duration_secs: float, **about: str | int) -> None:
    if event in _EVENTS:
        _log.append(f"{_EVENTS[event]} {about.get('fun_name', 'a program')}")


jax.monitoring.register_event_duration_secs_listener(_note)


def programs(call: Callable[[], object]) -> list[str]:
    """What JAX traced and compiled while `call` ran, on any thread: one entry for each."""
    _log.clear()
    jax.block_until_ready(jax.tree.leaves(call()))
    return list(_log)


SAMPLES = 1200


def start(k: float) -> Drive:
    """The plant of the recordings below, some tens of percent off: the more, the larger `k`."""
    law = PLANT.friction
    friction = LuGre(
        sigma0=law.sigma0 * (1.0 - 0.05 * k),
        sigma1=law.sigma1,
        sigma2=law.sigma2 * (1.0 + 0.2 * k),
        Fc=law.Fc * (1.0 + 0.05 * k),
        Fs=law.Fs * (1.0 + 0.05 * k),
        vs=law.vs,
    )
    return Drive(PLANT.J * (1.0 + 0.1 * k), friction, PLANT.motor_constant)


def loaded(k: float) -> Drive:
    """The same start with an effect whose strength is measured in parts of the plant's own friction."""
    return start(k).with_effects(effect("ConstantLoad"))


def recordings(
    seed: int, *, rate: float = 2000.0, prefix: str = "run", samples: int = SAMPLES, load: float = 0.0
) -> tuple[Recording, ...]:
    """A break-away and a loud noise of 0.6 s with the sensor's noise of one `seed`, under a constant `load`."""
    drive = PLANT.with_effects(effect("ConstantLoad", load=load))
    rng, found = np.random.default_rng(seed), []
    for i, u in enumerate((break_away(0.6)[:SAMPLES], large_noise(0.6, level=0.8)[:SAMPLES])):
        x = np.asarray(simulate(drive, u, rate).x) + 1e-6 * rng.standard_normal(SAMPLES)
        found.append(Recording(f"{prefix}{i}", rate, np.asarray(u[:samples], float), x[:samples]))
    return tuple(found)


def columns() -> dict[str, np.ndarray]:
    """A short table of a recording, in memory."""
    return {"t": np.arange(200) / 1e3, "u": np.ones(200), "x": np.cos(np.arange(200.0))}


def saved_diagnosis(folder: Path) -> Path:
    """A diagnosis that is saved in the `folder`."""
    return save_diagnosis(fake_diagnosis(n=500), folder, report=False)


def information() -> Information:
    matrix = 1e8 * (np.eye(2) + 0.1)
    return Information(("J", "Fc"), ("", ""), (True, True), np.ones(2), np.ones(2), matrix[None])


def arms(recording):
    """The verbs of arms that never touch JAX themselves: why, and a call that shows it, from a `recording`."""

    def refused(verb):
        with pytest.raises(api.InputError):
            verb([], "<nothing/>")

    def refused_folder(folder):
        (folder / "index.html").write_text("of others", encoding="utf-8")
        with pytest.raises(api.InputError):
            api.save_arm_diagnosis(api.ArmDiagnosis("arm", None, ()), folder)  # type: ignore[arg-type]

    table = {"t": recording.t, "q1": recording.u, "tau1": recording.x}
    return {
        "fit_rigid_body": ("least squares, in numpy", lambda _: refused(api.fit_rigid_body)),
        "diagnose_arm": ("numpy, and `diagnose`, which is counted", lambda _: refused(api.diagnose_arm)),
        "read_arm_log": ("reads a table", lambda _: api.read_arm_log(table)),
        "save_arm_diagnosis": ("writes files", refused_folder),
    }


def calibration(recording):
    """The verbs that check a diagnosis and never touch JAX themselves, as `arms` has them."""

    def uncalibrated(folder):
        with pytest.raises(api.InputError):
            api.calibration_of(api.load_study(kept_study(folder)))

    def unchecked():
        pytest.importorskip("zarr")
        case = api.Case("one", api.Plant(), (recording,))
        with pytest.raises(api.InputError):
            api.check_diagnosis(case, fake_diagnosis(n=20), 0)

    return {
        "calibration_study": ("a design and a task", lambda _: api.calibration_study(2)),
        "calibration_of": ("numpy on the results", uncalibrated),
        "check_diagnosis": ("simulates and diagnoses: these are counted", lambda _: unchecked()),
    }


def saved_fit(folder):
    """A fit that is saved in the `folder`."""
    covariance = np.eye(1)
    result = api.FitResult(
        PLANT, {"J": api.Estimate(1.0, 0.1, "kg")}, ("J",), covariance, covariance, {}, 0.0, True, "Done.", ()
    )
    api.save_fit(result, folder / "fit.json")
    return folder / "fit.json"


def configured():
    """JAX is set up once more."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"])  # put back afterwards
        api.configure_jax()


def unwarmed():
    """`warm` of an effect that there is not compiles nothing."""
    with pytest.raises(api.InputError):
        api.warm(["nothing"])
