"""Power curves: how well an experiment of a design tells two effects apart."""

import jax
import numpy as np
import pytest
from helpers_plants import TABLE_I, effect

import frictionjax as fj
from frictionjax import Axis, DiscriminationTask, Experiment, Factorial, InputError, Study

pytest.importorskip("zarr")

LOAD, DRAG = effect("ConstantLoad", load=0.02), effect("QuadraticDrag", drag=20.0)
RAMP = Experiment("ramp", samples=400, sample_rate=1000.0, level=1.5, noise=1e-6)


def test_it_is_that_of_rank_for_discrimination():
    task = DiscriminationTask(TABLE_I, LOAD, None, RAMP, refit_steps=2)
    axes = Axis("size", [0.01, 1.0]), Axis("noise", [1e-6, 1e-5])
    found = fj.run_study(Study(Factorial(*axes), task), progress=False)
    u = np.asarray(RAMP.input(jax.random.key(0), TABLE_I))
    for size in (0.01, 1.0):
        for noise in (1e-6, 1e-5):
            own = fj.rank_for_discrimination(
                TABLE_I,
                effect("ConstantLoad", load=0.02 * size),
                None,
                {"u": u},
                1000.0,
                noise,
                refit_steps=2,
            ).best
            at = found.sel(size=size, noise=noise).isel(repeat=0)
            assert float(at["d_prime"]) == pytest.approx(own.d_prime, rel=1e-6)
            assert float(at["power"]) == pytest.approx(own.probability, rel=1e-6)
    power = found["power"].isel(repeat=0)
    assert np.all(np.diff(power, axis=0) >= 0.0) and np.all(np.diff(power, axis=1) <= 0.0)
    assert float(power.min()) < 0.5 < float(power.max())
    assert found["converged"].dtype == bool and not found["failed"].any()


def test_a_case_in_which_two_effects_are_one_fails_with_a_reason():
    task = DiscriminationTask(TABLE_I, LOAD, DRAG, RAMP, refit_steps=0)
    with pytest.warns(match="1 of 2 cases failed"):
        found = fj.run_study(Study(Factorial(Axis("size", [0.0, 1.0])), task), progress=False)
    assert found["failed"].values.ravel().tolist() == [True, False]
    assert found["reason"].values.ravel()[0] and found["d_prime"].values.ravel()[1] > 0.0


def test_without_noise_anything_can_be_told_apart():
    with pytest.raises(InputError, match="an experiment has no noise"):
        Study(Factorial(), DiscriminationTask(TABLE_I, LOAD, None, Experiment()))
    for axis in ("noise", "encoder_step"):
        Study(Factorial(Axis(axis, [1e-8])), DiscriminationTask(TABLE_I, LOAD, None, Experiment()))


def test_quantisation_is_noise():
    def d_prime(**noise):
        experiment = Experiment("ramp", samples=400, sample_rate=1000.0, level=1.5, **noise)
        task = DiscriminationTask(TABLE_I, LOAD, None, experiment, refit_steps=0)
        return float(fj.run_study(Study(Factorial(), task), progress=False)["d_prime"].squeeze())

    assert d_prime(encoder_step=1e-6 * np.sqrt(12.0)) == pytest.approx(d_prime(noise=1e-6), rel=1e-9)


def test_what_it_is_is_kept_with_the_results():
    described = DiscriminationTask(TABLE_I, LOAD, None, RAMP).described()
    assert described["effects"] == [{"form": "ConstantLoad", "parameters": {"load": 0.02}}, None]
    assert described["experiment"]["signal"] == "ramp" and described["free"] is None
