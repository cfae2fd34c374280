"""Two roads to one answer: an effect as signals along the observed motion, and the effect in the structure itself."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, closed_loop, moves, open_loop, stick_noise
from helpers_plants import FORMS

from frictionjax.diagnosis.screening.linearised import BESIDE, present_model
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective.robust import extend, robust_posterior
from frictionjax.estimation.scales import plant_scales

# One form of each slot; the others are slow tests.
FAST = ("ConstantLoad", "DirectionAsymmetry", "Creep", "Delay", "EncoderError")
# What is left of the change, over the change: small steps are nearly linear. A lag of friction is not: its first
# moment after a reversal is lost in signals that do not see their own effect. Nor is a gap.
NEAR, NEAREST = 0.25, 0.02
LOOSE = {"FrictionLag": (0.5, 0.1), "Backlash": (0.3, 0.05)}


@pytest.fixture(scope="module")
def present():
    recordings = [
        open_loop("stick", stick_noise(2.0), seed=1),
        closed_loop("moves", moves(3.0), seed=2),
    ]
    # A machine that warms up by 10 K in each recording, for the effects that ask for it.
    recordings = tuple(
        dataclasses.replace(r, temperature=20.0 + 10.0 * np.linspace(0.0, 1.0, r.x.size)) for r in recordings
    )
    batch = make_batch(recordings, encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(2, bool))
    return present_model(posterior, vector), plant_scales(PLANT, batch)


def change(errors, present):
    return np.asarray(errors[0] - present.e)


@pytest.mark.parametrize(
    "form", [pytest.param(f, marks=() if f in FAST else (pytest.mark.slow,)) for f in FORMS]
)
def test_signals_do_what_the_effect_does(present, form):
    """A small strength: the innovations change alike, to the order of the change itself."""
    present, scales = present
    nuisances = {}
    for nuisance in FORMS[form].nuisances:
        if nuisance.grid == "period":
            nuisances[nuisance.name] = 0.2 * scales["stroke"]
        else:
            unit = nuisance.scale if isinstance(nuisance.scale, float) else scales[str(nuisance.scale)]
            nuisances[nuisance.name] = unit * nuisance.grid[0]
    posterior, vector = extend(present.posterior, present.vector, FORMS[form](**nuisances), scales)
    place = len(present.posterior.layout)
    stepped = jnp.asarray(vector).at[place].add(0.2 * FORMS[form].strengths[0].probes[0])
    told = change(present.injected([posterior], [stepped]), present)
    true = change(posterior.errors_at([stepped]), present)
    size = np.sqrt(np.mean(true**2))
    near, nearest = LOOSE.get(form, (NEAR, NEAREST))
    assert size > 0.0
    assert np.sqrt(np.mean((told - true) ** 2)) < near * size
    assert 1.0 - np.sum(told * true) / np.sqrt(np.sum(told**2) * np.sum(true**2)) < nearest


def test_without_an_effect_the_signals_change_nothing(present):
    present, scales = present
    posterior, vector = extend(present.posterior, present.vector, FORMS["ConstantLoad"](), scales)
    np.testing.assert_allclose(change(present.injected([posterior], [vector]), present), 0.0, atol=1e-9)
    assert jnp.all(jnp.isfinite(present.e))


def test_effects_that_go_together_do_what_each_does_alone(present):
    """Blocks of one to three vectors, in pairs and a last one alone; one has more vectors than there are lanes."""
    present, scales = present
    place, blocks = len(present.posterior.layout), []
    for form, count in (("ConstantLoad", 2), ("Delay", 1), ("Creep", BESIDE + 1), ("DirectionAsymmetry", 3)):
        posterior, vector = extend(present.posterior, present.vector, FORMS[form](), scales)
        steps = 0.1 * (1.0 + np.arange(count)) * FORMS[form].strengths[0].probes[0]
        blocks.append(([posterior] * count, [jnp.asarray(vector).at[place].add(step) for step in steps]))
    together = list(present.lanes(blocks))
    assert [len(errors) for errors in together] == [BESIDE, BESIDE, BESIDE + 1, BESIDE]
    for errors, (posteriors, vectors) in zip(together, blocks, strict=True):
        for number, (posterior, vector) in enumerate(zip(posteriors, vectors, strict=True)):
            alone = present.injected([posterior], [vector])[0]
            assert float(jnp.max(jnp.abs(alone - present.e))) > 1e-3
            np.testing.assert_allclose(errors[number], alone, rtol=1e-9, atol=1e-9)
