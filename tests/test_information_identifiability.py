"""What the data do not hold is named in words: sums, ratios, single parameters, and groups."""

import numpy as np
import pytest
from helpers_information import BREAK_AWAY, PRESLIDING, RATE, SLIDING, plan
from helpers_plants import PLANTS, ROTARY, TABLE_I

from frictionjax.core import InputError
from frictionjax.information.fisher import Information, fisher_information
from frictionjax.information.identifiability import identifiability, information_of

SUM = "sigma1 and sigma2 are held only as a sum"


def planned(drive, free=None, **settings):
    inputs, v0, noise = plan(drive, **settings)
    return fisher_information(drive, inputs, RATE, noise, v0=v0, free=free)


def small(matrix, names=("sigma0", "Fc", "Fs", "vs"), units=None):
    """Information of positive parameters that are 1 each."""
    count = len(names)
    matrix = np.asarray(matrix, dtype=float)[None]
    return Information(
        names, units or ("1",) * count, (True,) * count, np.ones(count), np.ones(count), matrix
    )


@pytest.mark.parametrize("plant", PLANTS)
def test_noise_below_break_away_holds_only_the_sum_of_the_dampings(plant):
    found = identifiability(planned(PLANTS[plant]).of(PRESLIDING))
    (sentence,) = [one for one in found.sentences if "sigma1" in one]
    assert sentence.startswith(SUM) and "sliding moves" in sentence
    assert "sigma2" in found.lost and not {"J", "sigma0"} & set(found.lost)
    assert found.combinations["sigma1 + sigma2"] < 0.01


@pytest.mark.parametrize("plant", PLANTS)
def test_the_sum_is_as_well_held_as_if_it_were_one_parameter(plant):
    drive = PLANTS[plant]
    f = drive.friction
    found = identifiability(planned(drive).of(PRESLIDING)).combinations["sigma1 + sigma2"]
    one = planned(drive, ("J", "sigma0", "sigma1")).of(PRESLIDING).std["sigma1"]
    # Its own bound cannot be below that of the model in which all others are known.
    assert one * float(f.sigma1 / (f.sigma1 + f.sigma2)) <= found * (1.0 + 1e-6)


@pytest.mark.parametrize("plant", PLANTS)
def test_small_noise_does_not_tell_the_friction_levels(plant):
    found = identifiability(planned(PLANTS[plant], level=0.01).of(PRESLIDING))
    assert {"Fc", "vs"} <= set(found.lost)
    assert any("through break-away" in one for one in found.sentences)


@pytest.mark.parametrize("plant", PLANTS)
def test_sliding_alone_does_not_hold_the_bristles(plant):
    found = identifiability(planned(PLANTS[plant]).of(SLIDING))
    assert {"sigma0", "sigma1", "Fs", "vs"} <= set(found.lost)
    assert any(one.startswith("sigma0 and sigma1 are not held at all") for one in found.sentences)
    assert any(one.startswith("Fs and vs are not held at all") for one in found.sentences)
    assert not any(one.startswith(SUM) for one in found.sentences) and not found.combinations
    assert not set(found.held) & set(found.lost)


@pytest.mark.parametrize("plant", PLANTS)
def test_three_parts_together_hold_everything(plant):
    found = identifiability(planned(PLANTS[plant]))
    assert (found.lost, found.sentences, found.directions, found.combinations) == ((), (), (), {})
    assert len(found.held) == 7 and max(found.held.values()) < 0.01


def test_an_unknown_motor_constant_leaves_only_ratios():
    free = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "motor_constant")
    known = planned(ROTARY)
    found = identifiability(planned(ROTARY, free))
    assert found.lost == ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "motor_constant")
    (sentence,) = found.sentences
    assert "and the motor constant are held only as ratios" in sentence and "known mass" in sentence
    # Each ratio is held as well as the parameter is with the constant known.
    for name in free[:6]:
        assert found.combinations[f"{name}/motor_constant"] == pytest.approx(known.std[name], rel=1e-3)


def test_both_the_ratio_and_the_sum():
    free = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "motor_constant")
    found = identifiability(planned(TABLE_I, free).of(PRESLIDING))
    assert "held only as ratios" in found.sentences[0]
    assert found.sentences[1].startswith(SUM)
    assert {"J/motor_constant", "sigma0/motor_constant"} <= set(found.combinations)


def test_noise_that_hides_everything_names_every_parameter():
    quiet = planned(TABLE_I).of(PRESLIDING)
    found = identifiability(
        Information(quiet.names, quiet.units, quiet.logs, quiet.values, quiet.scale, 1e-9 * quiet.parts)
    )
    assert found.held == {} and found.combinations == {} and len(found.lost) == 7
    assert all(any(name in one for one in found.sentences) for name in quiet.names)
    assert not any(one.startswith(SUM) for one in found.sentences)


@pytest.mark.parametrize("louder", [3.0, 10.0, 100.0])
def test_the_sum_is_told_once_whatever_the_noise(louder):
    """From sigma2 that is lost by its likeness to sigma1 only, to one far below what the noise lets through."""
    inputs, _, noise = plan(TABLE_I)
    found = identifiability(fisher_information(TABLE_I, inputs[PRESLIDING], RATE, louder * noise))
    (sentence,) = [one for one in found.sentences if "sigma2" in one]
    assert sentence.startswith(SUM)


def test_a_pair_is_told_as_a_pair():
    matrix = np.diag([100.0, 100.0, 50.0, 50.0])
    matrix[2, 3] = matrix[3, 2] = -50.0
    found = identifiability(small(matrix))
    assert found.lost == ("Fs", "vs")
    assert found.sentences[0].startswith("Fs and vs are held only together: Fs and vs up together changes")
    assert found.directions[0].weights == pytest.approx({"Fs": 1.0, "vs": 1.0})


def test_a_triple_and_what_is_larger():
    def along(row):
        row = np.asarray(row, dtype=float) / np.linalg.norm(row)
        return small(1e4 * (np.eye(4) - np.outer(row, row)))

    assert (
        identifiability(along([0, 1, 1, -1])).sentences[0].startswith("Fc, Fs and vs are held only together")
    )
    found = identifiability(along([1, 1, 1, -1]))
    assert found.sentences[0].startswith("sigma0, Fc, Fs and vs are held only together")
    assert "noise or slow loops" in found.sentences[0] and "slow moves" in found.sentences[0]


def test_random_matrices_leave_nothing_unexplained():
    rng = np.random.default_rng(3)
    for _ in range(100):
        rows = rng.standard_normal((int(rng.integers(1, 5)), 4)) * 10.0 ** rng.uniform(-2, 3, 4)
        found = identifiability(small(rows.T @ rows))
        assert all(any(name in one for one in found.sentences) for name in found.lost)
        assert bool(found.lost) == bool(found.sentences)


def test_a_covariance_and_its_information_say_the_same():
    known = planned(ROTARY).of(PRESLIDING, BREAK_AWAY)
    own = known.values
    covariance = np.linalg.inv(known.matrix) * np.outer(own, own)
    found = information_of(known.names, own, covariance)
    for name in known.names:
        assert found.std[name] == pytest.approx(known.std[name], rel=1e-4)
    wide = covariance.copy()
    wide[3, 3] += own[3] ** 2 * 25.0
    assert identifiability(information_of(known.names, own, wide)).lost == ("sigma2",)


def test_a_strength_counts_against_its_typical_size():
    matrix = np.diag([0.01**2, 0.2**2])
    for size, lost in ((1.0, ()), (0.1, ("load",))):
        given = information_of(("J", "load"), [1.0, 0.0], matrix, scale=[0.0, size])
        found = identifiability(given)
        assert found.lost == lost
        assert given.std["J"] == pytest.approx(0.01)
        if lost:
            assert found.sentences == (
                "load is not held at all: the positions do not change with it. Add an experiment that excites it "
                "above the noise.",
            )
        else:
            assert given.std["load"] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: identifiability(small(np.full((4, 4), np.nan))), "not finite"),
        (lambda: identifiability(small(np.diag([1.0, 1.0, 1.0, -1.0]))), "negative direction"),
        (lambda: information_of(("J",), [1.0], np.zeros((1, 1))), "no variance for J"),
        (lambda: information_of(("J",), [-1.0], np.ones((1, 1))), "J = -1"),
        (lambda: information_of(("J",), [np.nan], np.ones((1, 1))), "J = nan"),
        (lambda: information_of(("J", "Fc"), [1.0, 1.0], np.ones((1, 1))), "one of each"),
        (lambda: information_of(("J",), [1.0], np.full((1, 1), np.inf)), "not finite"),
    ],
)
def test_bad_input_is_a_sentence(call, words):
    with pytest.raises(InputError, match=words):
        call()
