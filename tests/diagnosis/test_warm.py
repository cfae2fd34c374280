"""Warm: afterwards the steps of a diagnosis, of any recordings, compile nothing."""

import jax
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT
from helpers_plants import effect

import frictionjax as fj
from frictionjax.core.programs import forget_programs
from frictionjax.core.setup import programs_folder
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.evidence.views import view
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.data.pieces import lengths_up_to, pieces_of
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.simulation import simulate


@pytest.fixture
def kept(tmp_path):
    """A folder of its own for compiled programs, as the program has one."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    forget_programs()  # what is in memory is not written once more
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def _recordings(rate, seconds, count):
    rng, found = np.random.default_rng(count), []
    for number in range(count):
        samples = int(rate * seconds) + 37 * number
        u = 1.5 * float(PLANT.friction.Fs) * np.sin(2.0 * np.pi * 1.3 * np.arange(samples) / rate + number)
        x = np.asarray(simulate(PLANT, u, rate, substeps=4).x) + NOISE * rng.standard_normal(samples)
        found.append(fj.Recording(f"{rate:g} Hz {number}", rate, u, x))
    return tuple(found)


def _diagnosed(recordings, form):
    """The steps that compile, from the base model to a refit that is viewed and tested beside others."""
    batch = make_batch(recordings, encoder_step=FINE)
    held_out = np.arange(len(recordings)) == len(recordings) - 1
    fast, start = robust_posterior(PLANT, batch, held_out)
    fitted, scales = descend(fast, start, steps=2), plant_scales(PLANT, batch)
    trials = try_form(present_model(fast, fitted.vector), [form], scales)
    posterior, vector = extend(fast, fitted.vector, form, scales)
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    again = descend(slow, vector, graduate=False, steps=2)
    model = Model(slow, again, judge(slow, again))
    answer_to_force(slow, again.vector)
    present_model(slow, again.vector)
    view(model.judgement, scene_of(model, tuple(one.name for one in recordings)))
    return trials


@pytest.mark.slow
def test_after_it_recordings_of_any_shape_compile_nothing(kept):
    found = fj.warm(["return_spring"], progress=False)
    assert found.structures == 2 and found.folder == programs_folder()
    assert found.programs > 0 and found.megabytes > 0.0
    made = []

    def note(event, duration, **about):
        if event == "/jax/core/compile/backend_compile_duration":
            made.append(about.get("fun_name"))

    first, other = _recordings(200.0, 3.1, 4), _recordings(1000.0, 1.3, 6)
    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        for recordings in (first, other):
            assert _diagnosed(recordings, effect("ReturnSpring"))
    finally:
        jax.monitoring.unregister_event_duration_listener(note)
    assert made == []
    again = fj.warm(["return_spring"], progress=False)
    assert again.programs == found.programs


def test_longer_recordings_have_programs_of_their_own():
    assert lengths_up_to(1) == lengths_up_to(16384) == [16384]
    assert lengths_up_to(16385) == lengths_up_to(65536) == [16384, 65536]
    for samples in (1, 16384, 16385, 70000):
        assert pieces_of(np.array([samples]))[0].length == lengths_up_to(samples)[-1]


def test_what_cannot_be_kept_or_named_is_refused(kept):
    with pytest.raises(fj.InputError, match='"springs" is no effect of the catalogue'):
        fj.warm(["springs"])
    jax.config.update("jax_compilation_cache_dir", None)
    with pytest.raises(fj.InputError, match="no folder for compiled programs"):
        fj.warm(["return_spring"])
