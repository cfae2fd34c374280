"""The user's own simulation as it was given: as a column of the recordings and as a model of the case."""

import dataclasses
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, break_away, large_noise, open_loop, truth

from frictionjax.core import InputError
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.recording_fits import recording_fits
from frictionjax.diagnosis.evidence.views import view
from frictionjax.diagnosis.findings.as_given import (
    as_given,
    simulation_as_given,
    where_it_misses,
)
from frictionjax.diagnosis.findings.not_diagnosed import REASON, not_diagnosed
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.intake.starting_point import check, starting_point
from frictionjax.diagnosis.mismatch_map.where_words import strongest
from frictionjax.diagnosis.verdict import Unexplained
from frictionjax.physics import Drive
from frictionjax.recordings import Case, Given, GivenModel, Plant
from frictionjax.simulation import simulate

CASE = Plant(16.0, "rad", "N*m", "V", FINE)
WEAK = dataclasses.replace(PLANT.friction, Fc=jnp.asarray(0.4), Fs=jnp.asarray(0.5))
OWN = Drive(PLANT.J, WEAK, PLANT.motor_constant)
"""The plant with less friction than it has: what the user simulates."""
STEPS = 4


@pytest.fixture(scope="module")
def arm():
    """Two recordings of the plant, the second one held out."""
    ramps = open_loop("ramps", break_away(), seed=1, substeps=STEPS)
    return ramps, open_loop("loud", large_noise(), seed=2, role="holdout", substeps=STEPS)


def _simulated(recording, drive=OWN):
    x = np.asarray(simulate(drive, recording.u, RATE, substeps=STEPS, x0=recording.x[0]).x)
    return dataclasses.replace(recording, simulated=x)


class Road:
    """One way to give the same simulation, and what is found of it beside the arm itself as the base model."""

    def __init__(self, case):
        self.starting = starting_point(case)
        batch = self.starting.batch.with_substeps(STEPS)
        self.scene = Scene(batch, self.starting.held_out, np.full(2, 50.0), self.starting.names)
        power = np.ones(np.asarray(batch.block_count).shape)
        self.base = view(Judgement(PLANT, np.zeros(2), power, self.starting.held_out, batch), self.scene)
        self.floor = np.ones(power.shape)
        self.given = as_given(self.starting, self.scene)
        self.fits = recording_fits(
            self.starting.recordings, self.scene, self.base, self.base, PLANT, self.given
        )
        self.where = where_it_misses(self.given, self.base, PLANT, CASE, self.scene, self.floor)
        self.said = simulation_as_given(self.given, self.fits, CASE, self.where, extended=False)


@pytest.fixture(scope="module")
def column(arm):
    return Road(Case("arm", CASE, tuple(map(_simulated, arm))))


@pytest.fixture(scope="module")
def model(arm):
    model = GivenModel({name: Given(value) for name, value in truth(OWN).items()})
    return Road(Case("arm", CASE, arm, model))


def test_a_column_and_a_model_of_the_same_simulation_agree(column, model):
    """Two roads: errors, map and words are the same; only a model predicts from measured samples."""
    assert (column.given.source, model.given.source) == ("column", "model")
    for one, other in zip(column.fits, model.fits, strict=True):
        assert one.free_run_rmse_given == pytest.approx(other.free_run_rmse_given, rel=1e-6)
        assert one.increment_rmse_given == pytest.approx(other.increment_rmse_given, rel=1e-6)
        assert one.prediction_rmse_given is None and other.prediction_rmse_given > 0.0
        assert one.free_run_rmse_given > 10.0 * one.free_run_rmse_base
    assert column.where.where == model.where.where
    for one, other in zip(column.where.bins, model.where.bins, strict=True):
        assert (one.axis, one.bin, one.count) == (other.axis, other.bin, other.count)
        assert (one.excess, one.share) == pytest.approx((other.excess, other.share), rel=1e-4, abs=1e-9)
        assert one.p_value == other.p_value


def test_a_simulation_that_lacks_friction_misses_where_the_machine_breaks_away(column):
    """As the map of a base model: shares add to one, and the base model itself is beside it, at the noise."""
    regimes = {one.bin.split(" (")[0]: one for one in column.where.bins if one.axis == "regime"}
    assert sum(one.share for one in regimes.values()) == pytest.approx(1.0)
    excess = {name: one.excess for name, one in regimes.items()}
    assert (
        max(excess, key=excess.get) == "slow sliding"
        and excess["slow sliding"] > 100.0 * excess["presliding"]
    )
    assert all(one.excess_extended < 1.5 and one.p_value < 0.01 for one in regimes.values())
    worst = strongest(column.where.bins, "regime")
    assert column.said.mismatch == column.where.bins
    assert column.said.where.startswith(worst.bin.removesuffix(")"))


def test_the_sentence_has_the_numbers_of_the_held_out_recordings(column, model):
    (kept,) = (one for one in column.fits if one.role == "holdout")
    start = (
        "On the held-out recordings your simulation as given (column `simulated`) misses the measured position by "
        f"{kept.free_run_rmse_given:.3g} rad rms in a free run, the base model by {kept.free_run_rmse_base:.3g}; "
        f"the motion of each 0.1 s it misses by {kept.increment_rmse_given:.3g}, "
        f"the base model by {kept.increment_rmse_base:.3g}."
    )
    assert column.said.sentence.startswith(start)
    assert column.said.sentence.endswith(f"It misses in: {column.where.where}.")
    assert "your model as given misses" in model.said.sentence
    nothing = ((), Unexplained(False, 0.0, ""), "", column.fits)
    assert summary_sentence("adequate", *nothing, given=column.said).endswith(column.said.sentence)
    assert "as given" not in summary_sentence("adequate", *nothing, given=model.said)


def test_a_simulation_that_is_right_is_at_the_noise(arm):
    """Beside the base model that made the recordings; an offset of a simulation is said, and is no error of the map."""
    shifted = [_simulated(one, PLANT) for one in arm]
    shifted = [dataclasses.replace(one, simulated=one.simulated + 0.25) for one in shifted]
    found = Road(Case("arm", CASE, shifted))
    assert "Most of that is a constant offset of 0.25 rad." in found.said.sentence
    assert found.where.where == "nowhere above the noise"
    for one in found.fits:
        assert one.increment_rmse_given == pytest.approx(one.increment_rmse_base, rel=0.05)


def test_recordings_without_the_column_are_left_out(arm, column):
    """Of the one that has it the numbers are the same; the map counts its samples alone."""
    fitted, kept = arm
    found = Road(Case("arm", CASE, (fitted, _simulated(kept))))
    assert [one.free_run_rmse_given for one in found.fits] == [None, column.fits[1].free_run_rmse_given]
    assert found.fits[0].free_given is None and found.fits[0].increment_rmse_given is None
    axis = [one.count for one in found.where.bins if one.axis == "direction"]
    assert sum(axis) <= kept.x.size < sum(one.count for one in column.where.bins if one.axis == "direction")
    nowhere = Road(Case("arm", CASE, arm))
    assert nowhere.given is None and nowhere.where is None and nowhere.said is None


def test_a_simulation_that_diverges_has_an_error_and_no_map(arm):
    fitted, kept = arm
    far = dataclasses.replace(kept, simulated=np.exp(np.minimum(np.arange(kept.x.size) * 1.0, 700.0)))
    found = Road(Case("arm", CASE, (fitted, far)))
    assert found.fits[1].free_run_rmse_given == np.inf and found.fits[1].increment_rmse_given == np.inf
    assert "inf rad rms in a free run" in found.said.sentence


@pytest.mark.untyped
def test_where_nothing_is_diagnosed_the_simulation_is_compared_all_the_same(column):
    base = type("Base", (), {"judgement": Judgement(PLANT, np.zeros(2), column.floor, None, None)})
    case = Case("arm", CASE, column.starting.recordings)
    found = not_diagnosed(case, base, column.scene, column.base, {}, (), "", {})
    assert found.summary.endswith(found.given.sentence) and "column `simulated`" in found.given.sentence
    assert found.given.where == "" and found.recordings[1].free_given is not None


@pytest.mark.untyped
def test_what_was_tried_in_vain_beside_a_fit_that_is_not_credible_is_not_called_untested(column):
    base = type("Base", (), {"judgement": Judgement(PLANT, np.zeros(2), column.floor, None, None)})
    case = Case("arm", CASE, column.starting.recordings)
    creep, ripple = SimpleNamespace(effect="creep"), SimpleNamespace(effect="ripple")
    steps = [SimpleNamespace(refits=[creep], trials=[creep, ripple])]
    found = not_diagnosed(case, base, column.scene, column.base, {}, (), "", {}, steps=steps)
    why = {one.effect: one.reason for one in found.candidates}
    assert "no model with it predicts better" in why["creep"] and "too little" in why["ripple"]
    assert why["delay"] == REASON and found.verdict == "unknown"


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: x[:-1], "`simulated` has the shape (4399,), and there are 4400 samples"),
        (
            lambda x: np.where(np.arange(x.size) < 7, x, np.nan),
            "4393 values of simulated are not finite, the first",
        ),
    ],
)
def test_a_simulation_of_another_length_or_without_numbers_is_refused(arm, change, words):
    whole = _simulated(arm[0])
    bad = dataclasses.replace(whole, simulated=change(whole.simulated))
    with pytest.raises(InputError) as found:
        check(Case("arm", CASE, (bad, arm[1])))
    said = str(found.value)
    assert words in said and "recording ramps" in said and "\n" not in said
