"""Parameters are reported without unpredictable blocks as long as the other blocks determine them well enough."""

import equinox as eqx
import numpy as np
import pytest
from helpers_estimation import PLANT, base_fit, break_away, large_noise, open_loop, stick_noise, truth

from frictionjax.diagnosis.base_model.fit_base import parameters_of


@pytest.fixture(scope="module")
def model():
    return base_fit(
        (PLANT,),
        (
            open_loop("stick", stick_noise(4.0), seed=1),
            open_loop("ramps", break_away(), seed=2),
            open_loop("loud", large_noise(4.0), seed=3),
        ),
    )


@pytest.mark.parametrize(("growth", "reported"), [(2.0, True), (4.0, False)])
def test_blocks_are_left_out_unless_errors_grow_to_three_times(model, monkeypatch, growth, reported):
    """What is left of each block makes every standard error `growth` times as large."""
    posterior, plain = model.posterior, parameters_of(model, {})
    less = np.asarray(posterior.weights[0]) / growth**2
    monkeypatch.setattr(
        "frictionjax.diagnosis.base_model.fit_base.predictable",
        lambda *arguments, **named: (eqx.tree_at(lambda p: p.weights, posterior, (less,)), True),
    )
    found = parameters_of(model, {}, 1e-3)
    for name, value in truth(PLANT).items():
        assert abs(found[name].value - value) < 4.0 * found[name].stderr, name
        # White errors are in proportion; those by clusters, which may be larger, are not.
        ratio = found[name].stderr / plain[name].stderr
        assert (1.2 < ratio < 1.05 * growth) if reported else ratio == 1.0, name
