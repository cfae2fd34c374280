"""What `fit` cannot do is refused in a sentence with a cure; what the data do not determine is reported."""

import dataclasses

import jax
import numpy as np
import pytest
from helpers_fit import (
    NAMES,
    NOISE,
    RATE,
    SAMPLES,
    experiment,
    fit_near,
    other_start,
)

from frictionjax.core import InputError, PrecisionError
from frictionjax.estimation import Observation
from frictionjax.recordings import Recording


@pytest.fixture(scope="module")
def recordings():
    return experiment()


class TestRefusals:
    """Errors are sentences with a cure."""

    def test_nothing_moves(self):
        rng = np.random.default_rng(0)
        still = [
            Recording(name, RATE, np.zeros(SAMPLES), 1e-6 * rng.integers(-1, 2, SAMPLES))
            for name in ("one", "two")
        ]
        with pytest.raises(
            InputError, match=r"no recording moves by more than a few steps.*Excite the machine more"
        ):
            fit_near(still)

    @pytest.mark.slow
    @pytest.mark.slow
    def test_one_that_does_not_move_is_reported(self, recordings):
        steps = 1e-6 * np.random.default_rng(0).integers(-1, 2, SAMPLES)
        found = fit_near([Recording("still", RATE, np.zeros(SAMPLES), steps), *recordings[1:]])
        assert "`still` hardly moves: it has almost no information on the parameters." in found.message

    def test_what_no_data_hold_is_reported(self):
        """Three recordings of noise alone."""
        rng = np.random.default_rng(0)
        quiet = [Recording(n, RATE, np.zeros(SAMPLES), NOISE * rng.standard_normal(SAMPLES)) for n in NAMES]
        found = fit_near(quiet)
        assert not any(estimate.identified for estimate in found.parameters.values())
        assert "Not identifiable from these data: J, sigma0" in found.message

    @pytest.mark.parametrize("channel", ["u", "x"])
    def test_a_gap(self, recordings, channel):
        values = np.array(getattr(recordings[1], channel))
        values[100:103] = np.nan
        with pytest.raises(InputError, match=rf"`{channel}` of `ramps` holds 3 values that are not finite"):
            fit_near([recordings[0], dataclasses.replace(recordings[1], **{channel: values})])

    def test_too_short(self, recordings):
        cut = dataclasses.replace(recordings[0], u=recordings[0].u[:150], x=recordings[0].x[:150])
        with pytest.raises(
            InputError, match=r"`stick` has 150 samples; at 1000 Hz it needs 200.*record longer"
        ):
            fit_near([cut])

    @pytest.mark.parametrize("choice", [{"weight": 0.0}, {"weight": -1.0}, {"noise": 0.0}, {"noise": -1e-6}])
    def test_weights_and_noise_that_are_not_positive(self, recordings, choice):
        with pytest.raises(InputError, match=r"`data`.*Give positive numbers\."):
            fit_near([Observation(recordings[0], **choice)])

    def test_no_data(self):
        with pytest.raises(
            InputError, match=r"`data`: there is nothing to fit\. Give at least one recording"
        ):
            fit_near([])

    def test_no_start(self, recordings):
        with pytest.raises(InputError, match=r"`drive`: no start is given"):
            fit_near(recordings, ())

    @pytest.mark.parametrize("name", ["Fc", "sigma2", "J"])
    def test_a_start_at_zero(self, recordings, name):
        with pytest.raises(ValueError, match=rf"`drive` starts at {name} = 0.*positive starting values"):
            fit_near(recordings, other_start({name: 0.0}))

    def test_a_start_that_overflows(self, recordings):
        hopeless = other_start({})
        hopeless = dataclasses.replace(hopeless, motor_constant=1e300 * hopeless.motor_constant)
        with pytest.raises(ValueError, match="No starting value gives finite predictions; check"):
            fit_near(recordings, hopeless)

    def test_float32(self, recordings):
        with jax.enable_x64(False), pytest.raises(PrecisionError, match="jax_enable_x64"):
            fit_near(recordings)

    def test_choices_that_cannot_be_meant(self, recordings):
        with pytest.raises(InputError, match=r"`fixed`: `mass` is not a parameter of this drive"):
            fit_near(recordings, fixed=("mass",))
