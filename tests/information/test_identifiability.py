"""What the data do not hold is named in words: sums, ratios, single parameters, and groups."""

import dataclasses

import jax
import numpy as np
import pytest
from helpers_information import BREAK_AWAY, PRESLIDING, RATE, SLIDING, plan
from helpers_plants import PLANTS, ROTARY, TABLE_I, effect

from frictionjax.core import InputError, PrecisionError
from frictionjax.estimation import fit
from frictionjax.exchange import load_fit, save_fit
from frictionjax.exchange.fit_file import fit_to_json
from frictionjax.excitation import prbs
from frictionjax.information.fisher import Information, fisher_information
from frictionjax.information.identifiability import identifiability, information_of
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate

SUM = "sigma1 and sigma2 are identifiable only as a sum"


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
    assert "sigma2" in found.unidentifiable and not {"J", "sigma0"} & set(found.unidentifiable)
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
    assert {"Fc", "vs"} <= set(found.unidentifiable)
    assert any("through break-away" in one for one in found.sentences)


@pytest.mark.parametrize("plant", PLANTS)
def test_sliding_alone_does_not_hold_the_bristles(plant):
    found = identifiability(planned(PLANTS[plant]).of(SLIDING))
    assert {"sigma0", "sigma1", "Fs", "vs"} <= set(found.unidentifiable)
    assert any(one.startswith("sigma0 and sigma1 are not identifiable at all") for one in found.sentences)
    assert any(one.startswith("Fs and vs are not identifiable at all") for one in found.sentences)
    assert not any(one.startswith(SUM) for one in found.sentences) and not found.combinations
    assert not set(found.identifiable) & set(found.unidentifiable)


@pytest.mark.parametrize("plant", PLANTS)
def test_three_parts_together_hold_everything(plant):
    found = identifiability(planned(PLANTS[plant]))
    assert (found.unidentifiable, found.sentences, found.directions, found.combinations) == ((), (), (), {})
    assert len(found.identifiable) == 7 and max(found.identifiable.values()) < 0.01


def test_an_unknown_motor_constant_leaves_only_ratios():
    free = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "motor_constant")
    known = planned(ROTARY)
    found = identifiability(planned(ROTARY, free))
    assert found.unidentifiable == ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "motor_constant")
    (sentence,) = found.sentences
    assert "and the motor constant are identifiable only as ratios" in sentence and "known mass" in sentence
    # Each ratio is held as well as the parameter is with the constant known.
    for name in free[:6]:
        assert found.combinations[f"{name}/motor_constant"] == pytest.approx(known.std[name], rel=1e-3)


def test_both_the_ratio_and_the_sum():
    free = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs", "motor_constant")
    found = identifiability(planned(TABLE_I, free).of(PRESLIDING))
    assert "identifiable only as ratios" in found.sentences[0]
    assert found.sentences[1].startswith(SUM)
    assert {"J/motor_constant", "sigma0/motor_constant"} <= set(found.combinations)


def test_noise_that_hides_everything_names_every_parameter():
    quiet = planned(TABLE_I).of(PRESLIDING)
    found = identifiability(
        Information(quiet.names, quiet.units, quiet.logs, quiet.values, quiet.scale, 1e-9 * quiet.parts)
    )
    assert found.identifiable == {} and found.combinations == {} and len(found.unidentifiable) == 7
    assert all(any(name in one for one in found.sentences) for name in quiet.names)
    assert not any(one.startswith(SUM) for one in found.sentences)


@pytest.mark.parametrize("louder", [3.0, 10.0, 100.0])
def test_the_sum_is_named_once_whatever_the_noise(louder):
    """From sigma2 that is lost by its likeness to sigma1 only, to one far below what the noise lets through."""
    inputs, _, noise = plan(TABLE_I)
    found = identifiability(fisher_information(TABLE_I, inputs[PRESLIDING], RATE, louder * noise))
    (sentence,) = [one for one in found.sentences if "sigma2" in one]
    assert sentence.startswith(SUM)


def test_a_pair_is_named_as_a_pair():
    matrix = np.diag([100.0, 100.0, 50.0, 50.0])
    matrix[2, 3] = matrix[3, 2] = -50.0
    found = identifiability(small(matrix))
    assert found.unidentifiable == ("Fs", "vs")
    assert found.sentences[0].startswith(
        "Fs and vs are identifiable only together: Fs and vs up together has"
    )
    assert found.directions[0].weights == pytest.approx({"Fs": 1.0, "vs": 1.0})


def test_a_triple_and_what_is_larger():
    def along(row):
        row = np.asarray(row, dtype=float) / np.linalg.norm(row)
        return small(1e4 * (np.eye(4) - np.outer(row, row)))

    assert (
        identifiability(along([0, 1, 1, -1]))
        .sentences[0]
        .startswith("Fc, Fs and vs are identifiable only together")
    )
    found = identifiability(along([1, 1, 1, -1]))
    assert found.sentences[0].startswith("sigma0, Fc, Fs and vs are identifiable only together")
    assert "noise or slow loops" in found.sentences[0] and "slow moves" in found.sentences[0]


def test_random_matrices_leave_nothing_unexplained():
    rng = np.random.default_rng(3)
    for _ in range(100):
        rows = rng.standard_normal((int(rng.integers(1, 5)), 4)) * 10.0 ** rng.uniform(-2, 3, 4)
        found = identifiability(small(rows.T @ rows))
        assert all(any(name in one for one in found.sentences) for name in found.unidentifiable)
        assert bool(found.unidentifiable) == bool(found.sentences)


def test_a_covariance_and_its_information_say_the_same():
    known = planned(ROTARY).of(PRESLIDING, BREAK_AWAY)
    own = known.values
    covariance = np.linalg.inv(known.matrix) * np.outer(own, own)
    found = information_of(known.names, own, covariance)
    for name in known.names:
        assert found.std[name] == pytest.approx(known.std[name], rel=1e-4)
    wide = covariance.copy()
    wide[3, 3] += own[3] ** 2 * 25.0
    assert identifiability(information_of(known.names, own, wide)).unidentifiable == ("sigma2",)


def test_a_strength_counts_against_its_typical_size():
    matrix = np.diag([0.01**2, 0.2**2])
    for size, lost in ((1.0, ()), (0.1, ("load",))):
        given = information_of(("J", "load"), [1.0, 0.0], matrix, scale=[0.0, size])
        found = identifiability(given)
        assert found.unidentifiable == lost
        assert given.std["J"] == pytest.approx(0.01)
        if lost:
            assert found.sentences == (
                "load is not identifiable at all: the positions do not change with it. "
                "Add an experiment that excites it above the noise.",
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


@pytest.fixture(scope="module")
def fitted():
    """A fit of the base model and a load to noise at a twentieth of break-away, which holds no load."""
    rate, rng = 1000.0, np.random.default_rng(3)
    breakaway = float(ROTARY.friction.Fs / ROTARY.motor_constant)
    u = np.asarray(prbs(jax.random.key(3), 1500, rate, 200.0, 0.05 * breakaway))
    x = np.asarray(simulate(ROTARY, u, rate, substeps=2).x) + 1e-6 * rng.standard_normal(1500)
    drive = ROTARY.with_effects(effect("ConstantLoad"))
    return fit(drive, (Recording("quiet", rate, u, x),), encoder_step=1e-9, scales={"Fc": 0.5})


def test_a_fit_of_presliding_holds_only_the_sum_of_the_dampings(fitted):
    assert fitted.success and fitted.at_bounds == ()
    found = identifiability(fitted)
    assert found.sentences[0] == (
        f"{SUM}: without sliding, friction opposes velocity by sigma1 + sigma2. Add sliding moves at several "
        "velocities."
    )
    # Of what is not identifiable at all the values are anyone's guess, and so is whether it is alone in that.
    assert all("Add slow moves through break-away" in one for one in found.sentences[1:])
    assert found.unidentifiable == ("sigma2", "Fc", "vs")
    assert {name for name, one in fitted.parameters.items() if not one.identified} <= set(
        found.unidentifiable
    )
    # The data, not the prior, hold the rest: nothing is held better than the fit says, with its prior.
    total = sum(fitted.parameters[name].value for name in ("sigma1", "sigma2"))
    assert abs(total / 6.06 - 1.0) < 4.0 * found.combinations["sigma1 + sigma2"] < 0.02
    for name in ("J", "sigma0"):
        own = fitted.parameters[name]
        assert 1.0 - 1e-9 < found.identifiable[name] / (own.stderr / own.value) < 2.0
    # A strength counts against its typical size: zero within its error, and held.
    assert found.identifiable["load"] == pytest.approx(fitted.stderr["load"], rel=0.1)
    assert abs(fitted.parameters["load"].value) < 3.0 * found.identifiable["load"]


def test_a_fit_that_was_read_from_a_file_is_reported_alike(fitted, tmp_path):
    again = load_fit(save_fit(fitted, tmp_path / "fit.json"))
    assert fit_to_json(again) == fit_to_json(fitted)
    assert (again.posterior, again.vector) == (None, None)
    here, there = identifiability(fitted), identifiability(again)
    assert there.identifiable == pytest.approx(here.identifiable, rel=1e-6)
    assert there.combinations == pytest.approx(here.combinations, rel=1e-6)
    assert (there.unidentifiable, there.sentences) == (here.unidentifiable, here.sentences)


def test_without_a_scale_a_strength_counts_against_its_own_size(fitted):
    """The stroke, in which a stiffness is measured, is not in a file."""

    def sprung(value):
        load = effect("ReturnSpring", stiffness=value)
        drive = dataclasses.replace(fitted.drive, effects=(load,))
        estimate = dataclasses.replace(fitted.parameters["load"], value=value)
        parameters = {name: one for name, one in fitted.parameters.items() if name != "load"}
        return dataclasses.replace(
            fitted,
            drive=drive,
            parameters=parameters | {"stiffness": estimate},
            names=(*fitted.names[:-1], "stiffness"),
            posterior=None,
            vector=None,
        )

    error = fitted.stderr["load"]
    assert "stiffness" in identifiability(sprung(-3.0 * error)).identifiable
    assert "stiffness" in identifiability(sprung(0.5 * error)).unidentifiable
    assert "stiffness" in identifiability(sprung(0.0)).unidentifiable


def test_parameters_at_their_ends_are_lost_by_themselves(fitted):
    plain = identifiability(fitted)
    found = identifiability(dataclasses.replace(fitted, at_bounds=("Fc", "vs")))
    assert found.unidentifiable == plain.unidentifiable
    assert found.sentences == (
        plain.sentences[0],
        "Fc and vs ended at a limit of the admissible range, so the limit sets the value, not the data. "
        "Widen the `bounds` if they are yours, or add slow moves through break-away, such as a ramp of the force to "
        "twice the static friction.",
    )
    assert found.identifiable["J"] == pytest.approx(plain.identifiable["J"], rel=0.01)
    everything = identifiability(dataclasses.replace(fitted, at_bounds=fitted.names))
    assert (everything.identifiable, everything.combinations, everything.unidentifiable) == (
        {},
        {},
        fitted.names,
    )
    assert "load ended at a limit" in everything.sentences[-1]
    assert "experiment that excites it" in everything.sentences[-1]


def test_parameters_without_a_finite_variance_are_lost_by_themselves(fitted):
    wide = fitted.covariance.copy()
    wide[0], wide[:, 0] = np.inf, np.inf
    found = identifiability(dataclasses.replace(fitted, covariance=wide))
    assert found.unidentifiable == ("J", "sigma2", "Fc", "vs")
    assert found.sentences[0].startswith(SUM)
    assert found.sentences[-1] == (
        "J got no finite variance in this fit. Fit again from other starting values."
    )
    nothing = identifiability(dataclasses.replace(fitted, covariance=np.full_like(wide, np.inf)))
    assert (nothing.identifiable, nothing.unidentifiable, len(nothing.sentences)) == ({}, fitted.names, 1)


def test_model_error_widens_what_a_fit_holds(fitted):
    """Raised standard deviations, as the sandwich raises them, come out."""
    twice = identifiability(dataclasses.replace(fitted, covariance=4.0 * fitted.covariance)).identifiable
    for name in ("J", "sigma0", "load"):
        assert twice[name] == pytest.approx(2.0 * identifiability(fitted).identifiable[name], rel=0.01)


def test_a_torn_covariance_and_float32_are_refused(fitted):
    torn = fitted.covariance.copy()
    torn[0, 1] = np.nan
    with pytest.raises(InputError, match="not finite"):
        identifiability(dataclasses.replace(fitted, covariance=torn))
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="float64"):
        identifiability(fitted)
