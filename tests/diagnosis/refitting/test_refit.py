"""Refits: where they begin."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT, closed_loop, moves, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.effort import Effort, RefittingEffort
from frictionjax.diagnosis.evidence.comparison import compare
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting import descents, refit
from frictionjax.diagnosis.refitting.descents import (
    CandidateDescent,
    RefitStart,
    from_before,
    uncoupled,
    with_a_peak,
    with_slow_observer,
)
from frictionjax.diagnosis.refitting.refit import Hints, refit_all
from frictionjax.diagnosis.refitting.shortlist import absorbed_by_base
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import forms_to_try, try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.data.pieces import SHORTEST, pieces_of
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.parameters import changed, pack
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import catalogue

GROWTH, QUIET = 0.1, 0.03
DRIVEN = PLANT.with_effects(effect("LoadDependence", growth=GROWTH))


@pytest.mark.parametrize("known", [False, True])
def test_the_inertia_found_is_taken_for_that_of_the_motor_alone(known):
    """Motor inertia, stiffness and damping stay what they were when a load of 0.3 of the whole is hung behind a gap; a
    known inertia is that of the whole."""
    batch = make_batch((open_loop("stick", stick_noise(), seed=1),), encoder_step=FINE)
    posterior, vector = robust_posterior(
        PLANT, batch, np.array([False]), fixed=frozenset({"J"} if known else ())
    )
    posterior, vector = extend(posterior, vector, effect("Backlash"), plant_scales(PLANT, batch))
    place = next(i for i, free in enumerate(posterior.layout) if free.parameter.name == "ratio")
    hung = uncoupled(posterior, jnp.asarray(vector).at[place].set(0.3 / posterior.layout[place].scale))
    drive = posterior.drive_of(hung)
    side = drive.load_side
    assert side is not None and float(side.ratio) == pytest.approx(0.3, rel=1e-12)
    factor = 1.0 if known else 1.0 / 0.7
    assert float(drive.J) == pytest.approx(factor * float(PLANT.J), rel=1e-9)
    for name in ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs"):
        assert float(getattr(drive.friction, name)) == pytest.approx(
            float(getattr(PLANT.friction, name)), rel=1e-9
        ), name
    assert bool(jnp.all(jnp.isfinite(hung)))


def _masked(form, absorbed, shown):
    return SimpleNamespace(form=type(form, (), {})(), absorbed=absorbed, shown=shown)


@pytest.mark.untyped
def test_what_would_show_and_can_be_undone_is_absorbed_by_base():
    trials = [
        _masked("Plain", 0.95, 2.0),
        _masked("Plain", 0.97, 3.0),
        _masked("TooSmall", 0.99, 0.5),
        _masked("Shows", 0.85, 50.0),
    ]
    assert absorbed_by_base(trials) == [trials[1]]
    many = [_masked(f"Form{k}", 0.91 + 0.01 * k, 2.0) for k in range(8)]
    assert [t.absorbed for t in absorbed_by_base(many)] == pytest.approx([0.98, 0.97, 0.96, 0.95, 0.94])


@pytest.fixture(scope="module")
def driven():
    """A machine whose friction grows with the load, moved by a servo, and the base model that is fitted to it; tests of
    two effects beside it."""
    recordings = tuple(
        closed_loop(f"moves_{k}", moves(3.0, ends), seed=k, drive=DRIVEN, noise=QUIET * NOISE)
        for k, ends in enumerate([(0.3, -0.1, 0.02), (-0.2, 0.25, 0.1)])
    )
    batch = make_batch(recordings, encoder_step=QUIET * FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(2, bool))
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    fitted = descend(slow, vector)
    model = Model(slow, fitted, judge(slow, fitted))
    scales = plant_scales(model.judgement.drive, batch)
    present = present_model(posterior, fitted.vector)
    tried = {
        name: try_form(present, forms_to_try(catalogue()[name][0], scales, {}), scales)
        for name in ("load_dependence", "delay")
    }
    return model, scales, present, tried


@pytest.mark.parametrize("name", ["Ripple", "PeriodicPositionDependence"])
def test_what_is_periodic_is_seen_to_repeat(driven, name):
    """Once alone; twice beside another force, if it is a force. What is not periodic does not count."""
    judged = driven[0].judgement
    floor = np.ones_like(judged.power)
    x = np.asarray(judged.batch.x)[np.asarray(judged.batch.valid) > 0.0]

    def seen(waves, *others):
        effects = (*(effect(other) for other in others), effect(name, period=np.ptp(x) / waves))
        after = eqx.tree_at(lambda j: j.drive, judged, judged.drive.with_effects(*effects))
        found = compare(judged, after, floor)
        assert all(type(beside) is bool for _, beside in found.waves)  # as JSON needs it
        return found.gains(Rule()).repeats

    for waves, alone, beside in ((0.9, False, False), (1.1, True, False), (2.1, True, True)):
        assert seen(waves) == seen(waves, "LoadDependence") == alone
        assert seen(waves, "GravityPendulum") == (beside if name == "Ripple" else alone)


def test_the_valley_undoes_what_a_step_does(driven):
    """As the regression says, by simulation: to first order, of the smaller of two steps."""
    _, scales, present, tried = driven
    trial = min(tried["load_dependence"], key=lambda t: t.shown)
    posterior, base = extend(present.posterior, present.vector, trial.form, scales)
    place = next(i for i, free in enumerate(posterior.layout) if free.parameter.name == "growth")
    plain, stepped, undone = posterior.errors_at(
        [base, jnp.asarray(base).at[place].set(trial.valley[place]), trial.valley]
    )
    shown, left = (float(jnp.mean((errors - plain) ** 2)) for errors in (stepped, undone))
    assert trial.absorbed > 0.999
    assert left < 0.05 * shown


def test_a_base_fit_that_took_friction_for_inertia_is_left_along_the_valley(driven):
    model, scales, _, tried = driven
    assert float(model.judgement.drive.J) > 1.08 * float(PLANT.J)
    other = max(tried["delay"], key=lambda t: t.gain)
    absorbed = absorbed_by_base(tried["load_dependence"])
    with ThreadPoolExecutor(1) as executor:
        found = refit_all([other], model, scales, executor, Hints(absorbed=absorbed))
    best = min(found, key=lambda r: r.model.fitted.misfit)
    assert best.effect == "load_dependence"
    assert float(best.model.judgement.drive.effects[-1].growth) == pytest.approx(GROWTH, rel=0.02)
    assert float(best.model.judgement.drive.J) == pytest.approx(float(PLANT.J), rel=0.02)


def test_what_was_refitted_before_is_found_again_from_where_it_was(driven):
    """With observers of other gains the base model may come to rest where no candidate finds out."""
    model, scales, _, tried = driven
    other, trial = (max(tried[name], key=lambda t: t.gain) for name in ("delay", "load_dependence"))
    with ThreadPoolExecutor(1) as executor:
        hints = Hints(absorbed=absorbed_by_base(tried["load_dependence"]))
        before = min(
            refit_all([other], model, scales, executor, hints), key=lambda one: one.model.fitted.misfit
        ).model
        (alone,) = refit_all([other], model, scales, executor)
        again = refit_all([other], model, scales, executor, Hints(before=[(trial, before)]))
    best = min(again, key=lambda one: one.model.fitted.misfit)
    assert best.effect == "load_dependence"
    assert best.model.fitted.misfit == pytest.approx(before.fitted.misfit, rel=1e-3)
    assert alone.model.fitted.misfit > 2.0 * before.fitted.misfit


@pytest.mark.untyped
def test_what_was_refitted_before_starts_with_its_own_sizes_whatever_they_are_counted_in(driven, monkeypatch):
    model, scales, *_ = driven
    load = effect("ConstantLoad", load=0.02)
    posterior, vector = extend(model.posterior, model.fitted.vector, load, scales)
    fitted = descend(posterior, vector, graduate=False, steps=0)
    before = Model(posterior, fitted, judge(posterior, fitted))
    start = refit._start(model, scales | {"Fc": 3.0 * scales["Fc"]}, Hints(), None, Rule(), Effort())
    monkeypatch.setattr(descents, "descend", lambda posterior, vector, **_: SimpleNamespace(vector=vector))
    found = from_before(start, SimpleNamespace(form=load.silenced()), before)
    drive = found.posterior.drive_of(found.fitted.vector)
    assert float(drive.effects[0].load) == pytest.approx(0.02, rel=1e-12)
    assert float(drive.J) == pytest.approx(float(before.judgement.drive.J), rel=1e-12)


def test_a_candidate_that_was_led_astray_starts_again_from_the_model(driven):
    """It has the inertia of another machine: it ends no higher than the model without it, and with its effect."""
    model, scales, _, tried = driven
    trial = max(tried["load_dependence"], key=lambda one: one.gain)
    start = refit._start(model, scales, Hints(), None, Rule(), Effort())
    posterior, silent = start.extended(trial)
    own = start.own(posterior)
    away = np.array(changed(silent, own, np.asarray(trial.vector)[own]))
    place = next(k for k, free in enumerate(posterior.layout) if free.path == "J")
    away[place] += np.log(30.0)
    astray = descend(posterior, away, graduate=False, steps=0)
    few = dataclasses.replace(Effort(), refitting=dataclasses.replace(RefittingEffort(), slow_steps=5))
    slow = with_slow_observer(
        dataclasses.replace(start, effort=few), CandidateDescent(trial, posterior, astray)
    )
    assert astray.misfit > 2.0 * model.fitted.misfit
    assert slow.model.fitted.misfit < model.fitted.misfit
    lost = CandidateDescent(
        trial, posterior, descend(posterior, np.full_like(away, np.nan), graduate=False, steps=0)
    )
    assert with_slow_observer(start, lost).model.fitted.misfit <= model.fitted.misfit


def _searching(samples):
    """An effort that searches by so many samples of each recording."""
    return Effort(refitting=dataclasses.replace(RefittingEffort(), searched_samples=samples))


def test_the_first_part_of_a_posterior_is_that_of_recordings_cut_short():
    recordings = tuple(open_loop(name, stick_noise(), seed=k) for k, name in enumerate(("one", "two")))
    batch = make_batch(recordings, encoder_step=FINE)
    whole, vector = robust_posterior(PLANT, batch, np.array([False, True]))
    most = 30 * batch.block
    short = tuple(dataclasses.replace(one, u=one.u[:most], x=one.x[:most]) for one in recordings)
    cut = dataclasses.replace(make_batch(short, encoder_step=FINE), noise=batch.noise, before=batch.before)
    part, alone = whole.first(most - 1), robust_posterior(PLANT, cut, np.array([False, True]))[0]
    assert part.batch.x.shape[1] == most < batch.x.shape[1]
    kept = np.s_[..., :most]
    np.testing.assert_allclose(
        part.errors_at([vector])[0], alone.errors_at([vector])[0][kept], rtol=1e-9, atol=1e-9
    )
    assert part.misfits([vector])[0] == pytest.approx(alone.misfits([vector])[0], rel=1e-9)


@pytest.mark.untyped
@pytest.mark.parametrize(("there", "is_part"), [(0.6, True), (0.4, False)])
def test_the_first_part_is_searched_where_it_shows_what_is_missing(there, is_part):
    def objective(misfit, **more):
        return SimpleNamespace(misfits=lambda vectors: [misfit], **more)

    part = objective(there)
    batch = SimpleNamespace(imposed=False, lengths=np.array([1001, 10]))
    whole = objective(1.0, batch=batch, first=lambda samples: part)
    searched, misfit = refit._searched(whole, np.zeros(1), _searching(1000))
    assert (searched is part) == is_part and misfit == (there if is_part else 1.0)
    assert refit._searched(whole, np.zeros(1), _searching(1001))[0] is whole


def test_a_refit_ends_on_all_samples_whatever_its_search_was_of(driven):
    model, scales, _, tried = driven
    trial = max(tried["load_dependence"], key=lambda t: t.gain)
    samples = model.posterior.batch.x.shape[1]
    with ThreadPoolExecutor(1) as executor:
        ends = [
            refit_all([trial], model, scales, executor, effort=_searching(most))[0].model
            for most in (samples, 2 * samples // 3)
        ]
    assert [end.posterior.batch.x.shape for end in ends] == [model.posterior.batch.x.shape] * 2
    misfits = [end.fitted.misfit for end in ends]
    assert misfits[1] == pytest.approx(misfits[0], rel=0.02)


class _Ended(SimpleNamespace):
    """A candidate of the form `form` whose descent ended at this `misfit`."""

    def __init__(self, form, misfit):
        super().__init__(trial=_masked(form, 0.0, 0.0), fitted=SimpleNamespace(misfit=misfit))


def _start_at(best, misfit=1.0):
    """A start at this `misfit` beside a base model without effects, with that of the `best` before."""
    base = SimpleNamespace(posterior=SimpleNamespace(drive=SimpleNamespace(effects=())))
    return RefitStart(base, None, None, misfit, best, {}, False, None, None, 0, Rule(), Effort())


@pytest.mark.untyped
@pytest.mark.parametrize(("left", "tried"), [(0.5, True), (0.02, True), (0.005, False)])
def test_a_peak_is_tried_wherever_something_is_left(monkeypatch, left, tried):
    """Of a misfit of 4 nats the best candidate leaves an eighth or less: it is not stuck, and the rest may be a lost
    peak, unless there is none."""
    peaks, end = [], _Ended("A", left)
    monkeypatch.setattr(refit, "with_a_peak", lambda start, one: peaks.append(one) or one)
    monkeypatch.setattr(refit, "at_the_resonance", lambda start, one: pytest.fail("it is not stuck"))
    with ThreadPoolExecutor(1) as executor:
        found = refit._from_other_starts([end], [], _start_at(np.inf, 4.0), Hints(), executor)
    assert found == [end] and peaks == ([end] if tried else [])


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("misfit", "left", "expected"),
    [(0.06, 0.03, (True, False)), (0.06, 0.01, (False, False)), (0.2, 0.1, (True, True))],
)
def test_what_the_base_absorbs_is_tried_wherever_much_is_left(monkeypatch, misfit, left, expected):
    """Friction that grows with the load may be a quarter more inertia, next to which little is missing at all. Only far
    from the noise all candidates begin again."""
    absorbed, again, end = [], [], _Ended("A", left)
    monkeypatch.setattr(refit, "with_a_peak", lambda start, one: one)
    monkeypatch.setattr(
        refit, "along_the_minimum", lambda start, one: absorbed.append(one) or _Ended("B", left)
    )
    monkeypatch.setattr(refit, "at_the_resonance", lambda start, one: again.append(one) or one)
    hints = Hints(absorbed=("of the base",))
    with ThreadPoolExecutor(1) as executor:
        found = refit._from_other_starts([end], [], _start_at(np.inf, misfit), hints, executor)
    assert (bool(absorbed), bool(again)) == expected
    assert len(found) == 1 + len(absorbed) and again in ([], [end])


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("best", "peak", "stay"),
    [(np.inf, 0.5, ["A", "B", "C", "D"]), (np.inf, 0.0, ["A", "B", "C", "D"]), (0.0, 0.5, ["A", "B", "C"])],
)
def test_candidates_are_given_up_behind_the_best_that_was_refitted_before(monkeypatch, best, peak, stay):
    """The best of these gains 0.5, the last one 0.15: more than a fifth of 0.5 and less than a fifth of 1. Nothing is
    stuck where another candidate explained all, and none but the first is then near the best. Else a Stribeck
    peak is tried, and where the first end with a `peak` is no better, the start of the base fit."""
    ends = [_Ended("A", 0.5), _Ended("B", 0.8), _Ended("C", 0.82), _Ended("D", 0.85), _Ended("D", 0.9)]
    monkeypatch.setattr(refit, "_start", lambda *_: _start_at(best))
    went_on, again, peaks = [], [], []

    def with_peak(start, end):
        peaks.append(end)
        return _Ended("A", peak) if end is ends[0] else end

    monkeypatch.setattr(
        refit, "further", lambda start, end: went_on.append(type(end.trial.form).__name__) or end
    )
    monkeypatch.setattr(refit, "with_a_peak", with_peak)
    monkeypatch.setattr(refit, "at_the_resonance", lambda start, end: again.append(end) or end)
    monkeypatch.setattr(refit, "with_slow_observer", lambda start, end: end)
    monkeypatch.setattr(refit, "_longest_first", lambda executor, start, trials: ends)
    monkeypatch.setattr(refit, "backlash_candidates", lambda trials: [])
    with ThreadPoolExecutor(1) as executor:
        found = refit_all(ends, None, {}, executor)
    assert went_on == stay
    assert bool(peaks) == np.isinf(best)
    assert bool(again) == (bool(peaks) and peak > 0.0)
    assert type(found[0].trial.form).__name__ == "A" and (len(found) == 1) == (0.0 in (best, peak))


def test_pieces_of_neighbouring_lengths_share_a_length_and_those_far_shorter_do_not():
    def lengths(*samples, pairs=False):
        return [piece.length for piece in pieces_of(np.array(samples), pairs=pairs)]

    near, far = [SHORTEST + 1] * 4 + [10], [4 * SHORTEST + 1] * 4 + [10]
    assert lengths(*near) == [4 * SHORTEST] * 2 and lengths(*far) == [16 * SHORTEST, SHORTEST]
    assert lengths(*near, pairs=True) == [4 * SHORTEST] * 2 + [SHORTEST]


def test_a_lost_stribeck_peak_is_found_again(driven):
    """With Fs near Fc and a vs beyond the motion a descent rests where no step says where the peak is; from another
    peak than the true one it finds that."""
    model, scales, _, tried = driven
    trial = max(tried["load_dependence"], key=lambda one: one.gain)
    start = refit._start(model, scales, Hints(), None, Rule(), Effort())
    posterior, silent = start.extended(trial)
    places = {free.path: place for place, free in enumerate(posterior.layout)}
    excess, speed = places["friction.Fs"], places["friction.vs"]
    true = np.concatenate([pack(posterior.layout, DRIVEN), np.zeros(len(silent) - len(posterior.layout))])
    other = changed(changed(posterior.start, excess, np.log(0.8)), speed, true[speed] + np.log(4.0))
    posterior = eqx.tree_at(lambda p: p.start, posterior, other)
    flat = changed(changed(true, excess, np.log(2e-3)), speed, true[speed] + np.log(20.0))
    lost = CandidateDescent(trial, posterior, descend(posterior, flat, graduate=False))
    found = with_a_peak(start, lost).fitted
    assert lost.fitted.misfit > 1.0 and abs(found.misfit) < 0.02
    friction = posterior.drive_of(found.vector).friction
    assert float(friction.vs) == pytest.approx(float(PLANT.friction.vs), rel=0.02)
    assert float(friction.Fs) == pytest.approx(float(PLANT.friction.Fs), rel=0.01)
