"""The check of a diagnosis on simulated machines: what is counted, what is simulated, and how it goes on."""

import dataclasses
import pickle

import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis
from helpers_estimation import FINE, NOISE, PLANT, RATE, open_loop, small_case, stick_noise
from helpers_plants import FORMS, effect, every_size

import frictionjax as fj
from frictionjax.core import Estimate
from frictionjax.diagnosis.verdict import MissingEffect
from frictionjax.estimation.parameters import part_of
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import simulate_imposed
from frictionjax.studies import StudyStopped, check
from frictionjax.studies.experiment import places_of
from frictionjax.studies.explanations import Explanation, _Fits
from frictionjax.studies.machines_file import forget_other_checks
from frictionjax.studies.simulated_recordings import conditions_of, recordings_like
from frictionjax.studies.worker import packed

pytest.importorskip("zarr")

RECORDED = tuple(
    Recording(name, RATE, np.zeros(500), 1e-6 * np.sin(np.arange(500.0)), role=role)
    for name, role in (("a", "fit"), ("b", "holdout"))
)
CASE = Case("bench", Plant(motor_constant=16.0), RECORDED)


def machine(inertia, *acting):
    """What may be behind the case: a machine that a test knows by its inertia."""
    return Explanation(acting, fj.Drive(inertia, PLANT.friction), np.zeros(2), 0.0)


MACHINES = (machine(1.0, "maxwell_slip"), machine(2.0, "creep"), machine(3.0))


def named(*classes):
    """A diagnosis that names effects of these classes; none: nothing is missing."""
    if not classes:
        return adequate_diagnosis()
    missing = tuple(MissingEffect(own[0], own, 0.9, 1e-9, {}, "") for own in classes)
    return dataclasses.replace(fake_diagnosis(n=20), missing=missing)


def rest_then_noise(seed=0):
    """A tenth of a second of rest, then noise well below break-away: where the machine starts is known."""
    return np.append(np.zeros(200), stick_noise(0.9, seed=seed))


ANSWERS = {
    1.0: [named(("maxwell_slip", "elasto_plastic"))] * 3 + [named(("creep",))],
    2.0: [named(("elasto_plastic", "maxwell_slip")), named(("creep", "maxwell_slip"))],
    3.0: [named(), named(("maxwell_slip",), ("creep",))],
}
"""Inertia of a machine -> what is said of it, in turn."""


@pytest.fixture
def asked(monkeypatch):
    """Machines and diagnoses that take no time: inertias of the machines that were diagnosed."""
    inertias = []

    def recordings(conditions, drive, deflection, rng):
        return tuple(dataclasses.replace(one, x=np.full(500, float(drive.J))) for one in RECORDED)

    def diagnose(case, *, without, progress, rule, effort):
        inertia = float(case.recordings[0].x[0])
        inertias.append(inertia)
        own = ANSWERS[inertia]
        return own[(inertias.count(inertia) - 1) % len(own)]

    monkeypatch.setattr(check, "explanations_of", lambda *given, **more: MACHINES)
    monkeypatch.setattr(check, "recordings_like", recordings)
    monkeypatch.setattr(check, "diagnose", diagnose)
    return inertias


def test_every_second_machine_is_the_diagnosed_one_and_answers_are_counted(asked):
    found = fj.check_diagnosis(CASE, named(("maxwell_slip",)), 16, progress=False).check
    assert asked == [1.0, 2.0, 1.0, 3.0] * 4
    assert (found.machines, found.failed) == (16, 0)
    (name,) = found.names
    # 6 of the 8 in which it acts; 2 with creep under another name and 2 in a class with creep, which is right; 2 of the
    # base model alone.
    assert (name.acting, name.found, name.given, name.right) == (8, 6, 12, 8)
    assert found.right == 6 + 2 + 2
    table = {(one.acting, one.named): (one.machines, one.right) for one in found.answers}
    assert table == {
        (("maxwell_slip",), ("maxwell_slip",)): (6, True),
        (("maxwell_slip",), ("creep",)): (2, False),
        (("creep",), ("elasto_plastic",)): (2, False),
        (("creep",), ("creep",)): (2, True),
        ((), ()): (2, True),
        ((), ("maxwell_slip", "creep")): (2, False),
    }
    assert found.answers[0].acting == ("maxwell_slip",) and found.answers[0].machines == 6


def test_where_nothing_is_named_the_base_model_is_simulated(asked, monkeypatch):
    monkeypatch.setattr(check, "explanations_of", lambda *given, **more: MACHINES[2:])
    found = fj.check_diagnosis(CASE, adequate_diagnosis(), 4, progress=False).check
    assert asked == [3.0] * 4 and found.names == () and found.right == 2
    assert found.sentences == (
        "Of 4 simulated machines 2 were diagnosed right (50 %, 95 % interval 15 to 85 %).",
    )


def test_a_machine_that_cannot_be_diagnosed_is_counted_apart(asked, monkeypatch):
    def fails(case, **more):
        if case.recordings[0].x[0] == 2.0:
            raise ValueError("no start is finite")
        return ANSWERS[1.0][0]

    monkeypatch.setattr(check, "diagnose", fails)
    with pytest.warns(fj.FrictionjaxWarning, match="1 of 4 cases failed; the first: ValueError: no start"):
        found = fj.check_diagnosis(CASE, named(("maxwell_slip",)), 4, progress=False).check
    assert (found.machines, found.failed) == (3, 1) and "1 more could not be" in found.sentences[-1]


def test_a_stopped_check_goes_on_with_the_same_machines(asked, monkeypatch, tmp_path):
    known, store, stages = check.diagnose, tmp_path / "out" / "check_8.zarr", []

    def stops(case, **more):
        if len(asked) == 3:
            raise KeyboardInterrupt
        return known(case, **more)

    monkeypatch.setattr(check, "diagnose", stops)
    with pytest.raises(StudyStopped) as stopped:
        fj.check_diagnosis(CASE, named(("maxwell_slip",)), 8, store=store, progress=False)
    assert "3 of 8 cases are finished" in str(stopped.value)

    def never(*given, **more):
        raise AssertionError("the machines are fitted again")

    monkeypatch.setattr(check, "diagnose", known)
    monkeypatch.setattr(check, "explanations_of", never)

    def again():
        return fj.check_diagnosis(
            CASE, named(("maxwell_slip",)), 8, store=store, progress=lambda *now: stages.append(now)
        ).check

    found = again()
    assert asked == [1.0, 2.0, 1.0, 3.0] * 2  # each of them once
    assert found == fj.check_diagnosis(CASE, named(("maxwell_slip",)), 8, store=store, progress=False).check
    assert len(asked) == 8 and fj.load_study(store)["acting"].size == 8
    fractions = [fraction for _, fraction in stages]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    forget_other_checks(store.parent, check.asked_of(CASE))
    assert store.exists()
    forget_other_checks(store.parent, check.asked_of(CASE, without=("delay",)))
    assert list(store.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"machines": 0}, "`machines` is 0"),
        ({"without": ["crepe"]}, '"crepe" is no effect of the catalogue'),
        ({"diagnosis": "refused"}, "nothing was diagnosed, so there is no answer to check"),
    ],
)
def test_what_cannot_be_checked_is_a_sentence(asked, given, words):
    diagnosis = named(("maxwell_slip",))
    if given.pop("diagnosis", ""):
        untested = tuple(dataclasses.replace(one, tested=False) for one in diagnosis.candidates)
        diagnosis = dataclasses.replace(diagnosis, candidates=untested)
    with pytest.raises(fj.InputError, match=words):
        fj.check_diagnosis(CASE, diagnosis, **given, progress=False)


def test_a_simulated_recording_differs_from_the_real_one_by_noise_alone():
    real = (
        open_loop("stick", rest_then_noise(), seed=1, substeps=8),
        open_loop("more", rest_then_noise(2), seed=2, substeps=8, role="holdout"),
    )
    like = recordings_like(
        conditions_of(real, force=0.0, encoder_step=FINE), PLANT, np.zeros(2), np.random.default_rng(0)
    )
    for one, other in zip(like, real, strict=True):
        assert (one.name, one.role, one.sample_rate) == (other.name, other.role, other.sample_rate)
        np.testing.assert_array_equal(one.u, other.u)
        # Noise of both: known to 1/sqrt(2 n) of its size; that of the simulation is an estimate, as good as that.
        difference = np.std(one.x - other.x) / (np.sqrt(2.0) * NOISE)
        assert abs(difference - 1.0) < 5.0 / np.sqrt(2.0 * one.x.size)
        np.testing.assert_allclose(one.x / FINE, np.round(one.x / FINE), atol=1e-4)


def test_an_unmeasured_force_moves_the_machine_as_the_motor_would():
    real = (open_loop("stick", rest_then_noise(), seed=1, substeps=8),)
    moved = []
    for force in (0.0, 0.02):  # with the same noise of the sensor
        conditions = conditions_of(real, force=force, encoder_step=None)
        moved.append(recordings_like(conditions, PLANT, np.zeros(1), np.random.default_rng(3))[0].x)
    push = 0.02 * np.random.default_rng(3).standard_normal(conditions.batch.u.shape)[0, : real[0].u.size]
    still, pushed = (fj.simulate(PLANT, real[0].u + more / 16.0, RATE, substeps=8).x for more in (0.0, push))
    assert np.std(pushed - still) > 1e-7
    np.testing.assert_allclose(moved[1] - moved[0], pushed - still, atol=1e-10)


def test_an_imposed_motion_stays_and_its_force_is_simulated():
    x = 0.01 * np.sin(2.0 * np.pi * np.arange(1500) / 500.0)
    force = np.asarray(simulate_imposed(PLANT, x, 500.0).friction)
    noisy = force + 0.01 * np.random.default_rng(1).standard_normal(force.size)
    real = (Recording("sine", 500.0, np.zeros(x.size), x, drive="motion", force=noisy),)
    (one,) = recordings_like(
        conditions_of(real, force=0.0, encoder_step=None), PLANT, np.zeros(1), np.random.default_rng(0)
    )
    np.testing.assert_array_equal(one.x, x)
    assert np.std(one.force - force) == pytest.approx(0.01, rel=0.2)


def test_a_check_can_be_sent_to_another_process():
    real = tuple(open_loop(name, np.zeros(500), seed=1, role=name) for name in ("fit", "holdout"))
    conditions = conditions_of(real, force=0.1, encoder_step=FINE)
    case = Case("bench", Plant(motor_constant=16.0), real)
    task = check.LikeYoursTask(case, conditions, MACHINES, (), fj.Rule(), fj.Effort(), check.asked_of(case))
    there = pickle.loads(packed(task))
    assert there.described() == task.described() and there.machine(3).acting == ()
    assert there.conditions.force == 0.1 and check.asked_of(there.case) == task.asked
    other = dataclasses.replace(real[0], x=real[0].x + 1e-9)
    assert check.asked_of(Case("bench", case.plant, (other, real[1]))) != task.asked


def test_a_machine_that_runs_away_is_a_sentence():
    real = (open_loop("stick", stick_noise(0.5), seed=1),)
    conditions = conditions_of(real, force=0.0, encoder_step=None)
    broken = fj.Drive(np.nan, PLANT.friction)
    with pytest.raises(fj.InputError, match="recording stick: the simulated machine runs away"):
        recordings_like(conditions, broken, np.zeros(1), np.random.default_rng(0))


def fits_of(*effects):
    """Fits beside a diagnosis that found these effects, without recordings."""
    drive = PLANT.with_effects(*effects)
    values = {label: part_of(drive, path) for label, path in places_of(drive).items()}
    missing = tuple(
        MissingEffect(
            one.name,
            (one.name,),
            0.9,
            0.0,
            {
                p.name: Estimate(float(getattr(one, p.name)), 0.1, "1")
                for p in (*one.strengths, *one.nuisances)
                if p.transform != "none"
            },
            "",
        )
        for one in effects
    )
    fits = object.__new__(_Fits)
    fits.base, fits.scales = PLANT, every_size(0.5)
    extended = {label: Estimate(float(value), 0.1, "1") for label, value in values.items()}
    fits.diagnosis = dataclasses.replace(fake_diagnosis(n=20), missing=missing, extended=extended)
    return fits


@pytest.mark.parametrize("name", FORMS)
def test_the_diagnosed_machine_has_the_form_and_the_sizes_that_were_found(name):
    form = FORMS[name]
    sizes = {one.name: 0.3 + 0.01 * k for k, one in enumerate((*form.strengths, *form.nuisances))}
    fits = fits_of(form(**sizes))
    found = [drive.effects[0] for drive in fits.with_effects(fits.diagnosis.missing)]
    own = [one for one in found if type(one) is form]
    assert own and all(type(one).name == form.name for one in found)
    for one in own:
        for parameter in (*form.strengths, *form.nuisances):
            if parameter.transform != "none":
                assert float(getattr(one, parameter.name)) == pytest.approx(sizes[parameter.name])


def test_effects_whose_parameters_have_one_name_keep_their_sizes():
    first, second = (
        effect("GravityPendulum", sine=1.0, cosine=0.2),
        effect("Ripple", sine=0.3, cosine=0.4, period=0.1),
    )
    fits = fits_of(first, second)
    (both,) = fits.with_effects(fits.diagnosis.missing)
    assert [float(one.sine) for one in both.effects] == [1.0, 0.3]
    (alone,) = fits.with_effects(fits.diagnosis.missing[1:])
    assert float(alone.effects[0].sine) == 0.3 and float(alone.friction.Fs) == float(PLANT.friction.Fs)


@pytest.mark.slow
def test_a_real_check_finds_the_twins_and_names_what_acts(tmp_path):
    case = small_case(late=2)
    found = fj.check_diagnosis(
        case, fj.diagnose(case, progress=False), 2, store=tmp_path / "c.zarr", progress=False
    )
    assert [one.effect for one in found.missing] == ["delay"]
    assert found.check.machines == 2 and found.check.failed == 0
    first = next(one for one in found.check.answers if one.acting == ("delay",))
    assert first.named == ("delay",) and first.right
