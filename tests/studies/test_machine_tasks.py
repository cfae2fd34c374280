"""Tasks with a simulated machine: what they compute is what the verbs compute one by one."""

import jax
import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis
from helpers_plants import TABLE_I

import frictionjax as fj
from frictionjax import Axis, Experiment, Factorial, FitTask, InputError, ResponseTask, SimulationTask, Study
from frictionjax.core import FrictionjaxWarning
from frictionjax.studies import fit_tasks
from frictionjax.studies.experiment import changed_drive, places_of

pytest.importorskip("zarr")

ONE = {"progress": False, "devices": jax.local_devices()[:1]}
LOADED = TABLE_I.with_effects(fj.catalogue()["constant_load"][0](load=0.05))
SHORT = Experiment(samples=256, level=0.1, bandwidth=300.0)


def test_a_simulation_is_that_of_simulate():
    axes = (Axis("sigma0", [1e5, 2e5]), Axis("noise", [0.0, 1e-7]), Axis("machine", ["plain", "loaded"]))
    task = SimulationTask({"plain": TABLE_I, "loaded": LOADED}, SHORT, lanes=2)
    found = fj.run_study(Study(Factorial(*axes), task), **ONE)
    assert found["x"].dims == ("sigma0", "noise", "machine", "repeat", "sample")
    for name, machine in (("plain", TABLE_I), ("loaded", LOADED)):
        law = fj.LuGre(2e5, *(getattr(machine.friction, n) for n in ("sigma1", "sigma2", "Fc", "Fs", "vs")))
        drive = fj.Drive(machine.J, law, machine.motor_constant, machine.effects)
        own = found.sel(sigma0=2e5, machine=name).isel(repeat=0)
        x = np.asarray(fj.simulate(drive, own.sel(noise=0.0)["u"].values, 2000.0).x)
        np.testing.assert_allclose(own.sel(noise=0.0)["x"], x, rtol=1e-10, atol=1e-18)
        noisy = own.sel(noise=1e-7)
        x = np.asarray(fj.simulate(drive, noisy["u"].values, 2000.0).x)
        # 256 samples: the standard deviation is known to 4.4 %.
        assert np.std(noisy["x"] - x) == pytest.approx(1e-7, rel=0.2)


def test_a_response_is_fitted_as_fit_sk_does():
    experiment = Experiment(samples=2048, noise=1e-9)
    task = ResponseTask(TABLE_I, experiment, segment=512, lanes=2, units={"stiffness": "N/m"})
    found = fj.run_study(Study(Factorial(Axis("sigma0", [0.8e5, 1.2e5], unit="N/m"), repeats=2), task), **ONE)
    np.testing.assert_allclose(found["stiffness_true"].values[:, 0], [0.8e5, 1.2e5])
    assert not found["failed"].any() and found["stiffness"].attrs["units"] == "N/m"
    key = jax.random.fold_in(jax.random.key(0), 3)
    machine = changed_drive(TABLE_I, {"sigma0": 1.2e5})
    u, x = experiment.record(key, machine)
    own = fj.fit_sk(fj.estimate_frf(u, x, 2000.0, segment=512), (3.0, 150.0))
    last = found.isel(sigma0=1, repeat=1)
    # Both fit the same lines; `fit_sk` takes steps of least squares proper at the end.
    assert float(last["stiffness"]) == pytest.approx(own.stiffness.value, rel=0.01)
    assert float(last["damping"]) == pytest.approx(own.damping.value, rel=0.02)
    assert float(last["inertia"]) == pytest.approx(own.J.value, rel=0.02)


def test_a_diagnosis_gives_its_verdict_and_its_names(monkeypatch):
    asked = []

    def diagnose(case, *, progress):
        asked.append(case)
        if len(asked) == 2:
            raise InputError("nothing moves", cure="Excite more")
        return fake_diagnosis(n=50) if len(asked) == 1 else adequate_diagnosis()

    monkeypatch.setattr(fit_tasks, "diagnose", diagnose)
    held = Experiment(samples=256, bandwidth=300.0, role="holdout")
    task = fj.DiagnosisTask(TABLE_I, (SHORT, held))
    with pytest.warns(FrictionjaxWarning, match="1 of 3 cases failed; the first: nothing moves"):
        found = fj.run_study(Study(Factorial(Axis("encoder_step", [1e-9]), repeats=3), task), progress=False)
    assert list(found["verdict"].values[0]) == ["named", "", "adequate"]
    assert list(found["named"].values[0]) == ["maxwell_slip", "", ""]
    assert found["confidence"].values[0, 0] == 0.98 and np.isnan(found["p_value"].values[0, 2])
    assert [recording.role for recording in asked[0].recordings] == ["fit", "holdout"]
    assert asked[0].plant.encoder_step == 1e-9 and asked[0].plant.motor_constant == 1.0
    x = asked[0].recordings[0].x
    np.testing.assert_allclose(x / 1e-9, np.round(x / 1e-9), atol=1e-6)


@pytest.mark.slow
def test_a_fit_finds_the_machine_of_its_case():
    experiments = (Experiment("ramp", samples=400, sample_rate=1000.0, level=2.0, noise=1e-8),)
    task = FitTask(TABLE_I, experiments, free=("Fc", "Fs"), lanes=2)
    found = fj.run_study(Study(Factorial(Axis("Fs", [1.4, 1.6]), repeats=2), task), progress=False)
    np.testing.assert_allclose(found["Fs_estimate_true"].values, [[1.4] * 2, [1.6] * 2])
    assert not found["failed"].any()
    assert np.all(
        np.abs(found["Fs_estimate"] - found["Fs_estimate_true"]) < 6.0 * found["Fs_estimate_stderr"]
    )
    summary = fj.summarise(found, over=("Fs", "repeat"))
    assert float(summary["Fs_estimate_rmse"]) < 0.05


def _study(task, *axes):
    return lambda: Study(Factorial(*axes), task)


def _run(task, *axes):
    return lambda: fj.run_study(Study(Factorial(*axes), task), **ONE)


SHORTEST = Experiment(samples=1000)


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            _study(SimulationTask(TABLE_I), Axis("weight", [1.0])),
            "called `weight`.*axis by one of: Fc, Fs, J",
        ),
        (_study(SimulationTask({"a": TABLE_I})), "there are several of `machine`.*an axis of their names"),
        (_study(ResponseTask(TABLE_I, SHORTEST)), "1000 samples in segments of 1024 give"),
        (_study(FitTask(TABLE_I, ())), "there is no experiment"),
        (_study(fj.DiagnosisTask(TABLE_I, (SHORT,))), "recordings that are held out"),
        (_run(SimulationTask({"a": TABLE_I}, SHORT), Axis("machine", ["b"])), "there is no machine 'b'"),
        (_run(SimulationTask(TABLE_I, SHORT), Axis("signal", ["b"])), "there is no signal 'b'"),
    ],
)
def test_what_is_not_of_the_machine_is_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_the_parameters_of_effects_have_names():
    assert places_of(LOADED)["load"] == "effects.0.load"
    twice = LOADED.with_effects(fj.catalogue()["constant_load"][0](load=0.05))
    assert places_of(twice)["constant_load.load"] == "effects.1.load"
    assert Axis("constant_load.load", [0.1]).name == "constant_load.load"


def test_a_description_names_every_number():
    study = Study(Factorial(Axis("noise", [1e-8])), ResponseTask(LOADED))
    about = study.described()["task"]
    assert about["machine"]["parameters"]["load"] == 0.05 and about["machine"]["effects"] == ["ConstantLoad"]
    assert about["experiment"]["signal"] == "prbs" and about["band"] == [3.0, 150.0]
