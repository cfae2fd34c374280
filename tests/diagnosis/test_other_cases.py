"""Cases of other lengths, rates and numbers of recordings use the programs of the first: nothing is compiled again."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT
from helpers_plants import effect

import frictionjax as fj
from frictionjax.diagnosis.base_model.fit_base import parameters_of
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene, judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.evidence.views import ahead_samples, force_bandwidth, view
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.simulation import observe, observer_gains, predict_ahead, residual_force, simulate


def _recordings(rate, seconds, count, seed):
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        samples = int(rate * seconds) + 37 * number
        u = 1.5 * float(PLANT.friction.Fs) * np.sin(2.0 * np.pi * 1.3 * np.arange(samples) / rate + number)
        x = np.asarray(simulate(PLANT, u, rate, substeps=4).x) + NOISE * rng.standard_normal(samples)
        found.append(fj.Recording(f"{rate:g} Hz {number}", rate, u, x))
    return tuple(found)


@pytest.fixture
def compiled():
    """Names of the functions that were compiled since the list was last emptied."""
    names = []

    def note(event, duration, **about):
        if event == "/jax/core/compile/backend_compile_duration":
            names.append(about.get("fun_name"))

    jax.monitoring.register_event_duration_secs_listener(note)
    yield names
    jax.monitoring.unregister_event_duration_listener(note)


def _steps_of_a_diagnosis(recordings):
    batch = make_batch(recordings, encoder_step=FINE)
    held_out = np.arange(len(recordings)) == len(recordings) - 1
    fast, start = robust_posterior(PLANT, batch, held_out)
    fitted = descend(fast, start, steps=3)
    slow = fast.at_bandwidth(SLOW_BANDWIDTH)
    again = descend(slow, fitted.vector, graduate=False, steps=3)
    judgement = judge(slow, again)
    answer_to_force(slow, again.vector)
    parameters_of(Model(slow, again, judgement), {})
    names = tuple(one.name for one in recordings)
    bandwidth = np.minimum(SLOW_BANDWIDTH, 0.1 / np.asarray(batch.dt))
    view(judgement, Scene(batch, held_out, bandwidth, names))
    scales = plant_scales(judgement.drive, batch)
    return try_form(present_model(fast, fitted.vector), [effect("ReturnSpring")], scales)


def test_a_view_is_what_the_verbs_say_of_each_recording():
    """Pieces of padded recordings of two rates, and each recording by itself."""
    recordings = (*_recordings(500.0, 2.0, 3, seed=5), *_recordings(400.0, 1.6, 2, seed=6))
    batch, held_out = make_batch(recordings, encoder_step=FINE), np.zeros(5, bool)
    z0 = np.array([0.0, 0.1, -0.1, 0.2, 0.0])
    judgement = Judgement(PLANT, z0, np.ones((5, 1)), held_out, batch)
    bandwidth = np.minimum(SLOW_BANDWIDTH, 0.1 / np.asarray(batch.dt))
    seen = view(judgement, Scene(batch, held_out, bandwidth, tuple(one.name for one in recordings)))
    for row, recording in enumerate(recordings):
        n, dt, x = recording.x.size, 1.0 / recording.sample_rate, jnp.asarray(recording.x)
        before = jax.tree.map(lambda leaf, row=row: leaf[row], batch.before)
        bent = z0[row] * float(PLANT.friction.Fs / PLANT.friction.sigma0)
        start = jax.tree.map(jnp.asarray, (batch.x0[row], batch.v0[row], bent, before))
        gains = observer_gains(min(SLOW_BANDWIDTH, 0.1 / dt), dt)
        step = jnp.asarray(dt)
        force, steps = PLANT.applied_force(jnp.asarray(recording.u), step), batch.substeps
        observed = observe(PLANT, force, x, step, gains, start, substeps=steps)
        horizon = ahead_samples(dt)
        ahead = predict_ahead(
            PLANT, force, x, step, gains, start, horizon=horizon, stride=max(horizon // 40, 1), substeps=steps
        )
        free = simulate(PLANT, recording.u, 1.0 / dt, x0=x[0], substeps=max(steps, 2), before=before).x
        missing = residual_force(PLANT, force, x, step, force_bandwidth(dt), start, substeps=steps)
        pairs = ((seen.ahead, ahead), (seen.free, free), (seen.v, observed.v), (seen.force, missing))
        for got, expected in pairs:
            scale = np.max(np.abs(expected))
            np.testing.assert_allclose(got[row, :n], expected, rtol=0.0, atol=1e-9 * scale)


def test_another_case_compiles_nothing(compiled):
    first = [_recordings(500.0, 2.0, count, seed=count) for count in (2, 7)]
    others = [_recordings(200.0, 3.1, 4, seed=1), _recordings(1000.0, 1.3, 5, seed=3)]
    for one in first:
        _steps_of_a_diagnosis(one)
    compiled.clear()
    for other in others:
        assert _steps_of_a_diagnosis(other)
        assert compiled == []
