"""Cases of other lengths, rates and numbers of recordings use the programs of the first: nothing is compiled again."""

import jax
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT
from helpers_plants import effect

import frictionjax as fj
from frictionjax.diagnosis.evidence.judgement import Scene, judge
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.evidence.views import view
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.finer import at_finer_steps
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.simulation import simulate


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
    at_finer_steps(slow, again.vector, again.near, slow.evaluated(again.vector)[0])
    names = tuple(one.name for one in recordings)
    view(judgement, Scene(batch, held_out, SLOW_BANDWIDTH, names))
    scales = plant_scales(judgement.drive, batch)
    return try_form(present_model(fast, fitted.vector), [effect("ReturnSpring")], scales)


def test_another_case_compiles_nothing(compiled):
    first = [_recordings(500.0, 2.0, count, seed=count) for count in (2, 7)]
    others = [_recordings(200.0, 3.1, 4, seed=1), _recordings(1000.0, 1.3, 5, seed=3)]
    for one in first:
        _steps_of_a_diagnosis(one)
    compiled.clear()
    for other in others:
        assert _steps_of_a_diagnosis(other)
        assert compiled == []
