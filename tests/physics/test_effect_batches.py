"""Every effect in a batch of strengths, and the slopes of those that are a force."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import FORMS, NUISANCES, SMALL, TABLE_I, effect

from frictionjax.physics.effects import AbstractForceEffect

H = jnp.asarray(1e-4)


def _made(form, first):
    """The form with its `first` strength, and the nuisances of NUISANCES."""
    return FORMS[form](**(NUISANCES.get(form, {}) | {FORMS[form].strengths[0].name: first}))


def _act(made):
    """All that an effect changes: the applied force, friction, states, the sensor, and the load side."""
    drive = TABLE_I.with_effects(made)
    z = 8e-6 * jnp.ones(drive.bristle_count)
    x, v, dt = jnp.asarray(1.7e-4), jnp.asarray(2e-3), jnp.asarray(1e-4)
    hidden = 1e-3 * jnp.ones(drive.hidden_count)
    friction = drive.friction_force(drive.bristles(), x, v, z, H, hidden, 0.3)
    flow = drive.relaxation(drive.instant(x, v, 0.3, 0.0, hidden))
    u = 4.0 * jnp.sin(jnp.arange(7.0))
    return drive.applied_force(u, dt), friction, flow, drive.measured(x, dt, hidden), drive.load_side


@pytest.fixture(scope="module")
def batches():
    """What every form does at three strengths, form -> results, of one effect for all three, and of one for each: a
    program for all batches, and one for all single effects."""
    strengths = {form: 10.0 * SMALL.get(form, 0.01) * np.array([0.0, 0.5, 1.7]) for form in FORMS}

    @eqx.filter_jit
    def batched(strengths):
        made = {
            form: eqx.filter_vmap(lambda s, form=form: _made(form, s))(own) for form, own in strengths.items()
        }
        return {form: eqx.filter_vmap(_act)(one) for form, one in made.items()}

    @eqx.filter_jit
    def single(strengths):
        return {form: _act(_made(form, own)) for form, own in strengths.items()}

    each = [single({form: jnp.asarray(own[k]) for form, own in strengths.items()}) for k in range(3)]
    return batched(strengths), each


@pytest.mark.parametrize("form", FORMS)
def test_effects_batch(batches, form):
    """A batch of strengths in one effect gives what one effect for each strength gives."""
    batched, each = batches
    singles = [jax.tree.leaves(one[form]) for one in each]
    for got, *expected in zip(jax.tree.leaves(batched[form]), *singles, strict=True):
        np.testing.assert_allclose(got, np.stack(expected), rtol=1e-13)
    weak, _, strong = singles
    assert any(
        not np.allclose(one, other, rtol=1e-6, atol=0.0) for one, other in zip(weak, strong, strict=True)
    )


@pytest.fixture(scope="module")
def force_slopes():
    """Derivative by the position of every force effect, form -> (automatic, by a central difference)."""
    forms = [form for form in FORMS if issubclass(FORMS[form], AbstractForceEffect)]

    @jax.jit
    def every(x, step):
        found = {}
        for form in forms:
            made = effect(form, **{parameter.name: 0.3 for parameter in FORMS[form].strengths})
            drive = TABLE_I.with_effects(made)
            hidden = 0.5 * jnp.ones(drive.hidden_count)

            def force(x, made=made, drive=drive, hidden=hidden):
                return made.force(TABLE_I.friction, drive.instant(x, jnp.asarray(0.01), 0.7, 0.2, hidden))

            found[form] = jax.grad(force)(x), (force(x + step) - force(x - step)) / (2 * step)
        return found

    return every(jnp.asarray(1.1e-4), jnp.asarray(1e-8))


@pytest.mark.parametrize("form", [f for f in FORMS if issubclass(FORMS[f], AbstractForceEffect)])
def test_force_effects_are_smooth_in_position(force_slopes, form):
    slope, difference = force_slopes[form]
    assert float(slope) == pytest.approx(float(difference), rel=1e-6, abs=1e-9)
