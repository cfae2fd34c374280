"""Ranking of candidate experiments: against brute force, against known physics, and what it says of bad input."""

import itertools

import jax
import jaxtyping
import numpy as np
import pytest
from helpers_information import BREAK_AWAY, PRESLIDING, RATE, SLIDING, N, plan
from helpers_plants import PLANTS, ROTARY, effect

from frictionjax.core import InputError
from frictionjax.excitation import prbs
from frictionjax.information import fisher, fisher_information, rank_experiments

NAMES = ("presliding", "break_away", "sliding")


def candidates(drive):
    """The three experiments of `plan` by name, their start velocities and the noise."""
    inputs, v0, noise = plan(drive)
    return dict(zip(NAMES, inputs, strict=True)), v0, noise


def value(matrix, criterion, places):
    """The criterion of an information matrix by the textbook: prior of 3, determinant and inverse."""
    full = matrix + np.eye(len(matrix)) / 9.0
    covariance = np.linalg.inv(full)[np.ix_(places, places)]
    if criterion == "A":
        return -np.mean(np.diag(covariance))
    return 0.5 * np.linalg.slogdet(full)[1] if criterion == "D" else -0.5 * np.linalg.slogdet(covariance)[1]


@pytest.mark.parametrize(
    ("criterion", "of"),
    [("D", None), ("parameter", "Fs"), ("parameter", ("sigma2", "J")), ("A", None), ("A", ("sigma1", "Fc"))],
)
def test_gains_are_those_of_brute_force(criterion, of):
    given, v0, noise = candidates(ROTARY)
    noise = (
        1e3 * noise
    )  # inverse and determinant of the matrix itself lose all digits at the noise of the plan
    before = fisher_information(ROTARY, given["presliding"], RATE, noise)
    found = rank_experiments(ROTARY, given, RATE, noise, v0=v0, known=before, criterion=criterion, of=of)
    asked = [before.names.index(n) for n in ((of,) if isinstance(of, str) else of or before.names)]
    gains = {}
    for name, start in zip(NAMES, v0, strict=True):
        own = fisher_information(ROTARY, given[name], RATE, noise, v0=start)
        gains[name] = value(before.matrix + own.matrix, criterion, asked) - value(
            before.matrix, criterion, asked
        )
        entry = next(one for one in found.entries if one.name == name)
        assert entry.gain == pytest.approx(gains[name], rel=1e-5, abs=1e-8)
        assert entry.std == (before + own).std
    assert [one.name for one in found.entries] == sorted(gains, key=lambda name: -gains[name])


@pytest.mark.parametrize("plant", PLANTS)
def test_the_physics_that_everybody_knows(plant):
    drive = PLANTS[plant]
    given, v0, noise = candidates(drive)

    def gains(parameter):
        found = rank_experiments(drive, given, RATE, noise, v0=v0, criterion="parameter", of=parameter)
        return {one.name: one.gain for one in found.entries}, found.best.name

    stiffness, _ = gains("sigma0")
    assert stiffness["presliding"] > 7.0 > 1e-6 > stiffness["sliding"]
    viscous, best = gains("sigma2")
    assert best == "sliding" and viscous["presliding"] < 1.0
    assert gains("Fs")[1] == "break_away"


def test_what_is_known_already_adds_least():
    given, v0, noise = candidates(ROTARY)
    known = fisher_information(ROTARY, [given["presliding"]] * 8, RATE, noise)
    fresh = rank_experiments(ROTARY, given, RATE, noise, v0=v0)
    then = rank_experiments(ROTARY, given, RATE, noise, v0=v0, known=known)
    assert then.entries[-1].name == "presliding"
    # Nine in place of eight: half the logarithm of 9/8 for each parameter that is held.
    assert 4.0 < then.entries[-1].gain / (0.5 * np.log(9.0 / 8.0)) < 7.0 + 1e-6
    before = {one.name: one.gain for one in fresh.entries}
    assert all(one.gain < before[one.name] for one in then.entries)


def test_the_greedy_plan_adds_up_and_is_near_the_best():
    given, v0, noise = candidates(ROTARY)
    found = rank_experiments(ROTARY, given, RATE, noise, v0=v0)
    steps = found.plan(3)
    assert steps[0].name == found.best.name and steps[0].gain == pytest.approx(found.best.gain)
    assert steps[0].sentence.startswith("Step 1: ")
    order = [one.name for one in found.entries]
    whole = found.information.of(*(order.index(one.name) for one in steps))
    assert steps[-1].std == pytest.approx(whole.std)
    best = 0.0
    for names in itertools.combinations_with_replacement(given, 3):
        together = {"all": [given[name] for name in names]}
        v = [v0[NAMES.index(name)] for name in names]
        best = max(best, rank_experiments(ROTARY, together, RATE, noise, v0=v).best.gain)
    assert (1.0 - 1.0 / np.e) * best <= sum(one.gain for one in steps) <= best * (1.0 + 1e-9)
    assert [
        one.name for one in rank_experiments(ROTARY, {"only": given["sliding"]}, RATE, noise).plan(2)
    ] == [
        "only",
        "only",
    ]


def test_a_session_of_several_records_is_one_candidate():
    given, v0, noise = candidates(ROTARY)
    both = {"both": [given["presliding"], given["sliding"][:600]]}
    found = rank_experiments(ROTARY, both, RATE, noise, v0=[0.0, v0[SLIDING]])
    apart = fisher_information(ROTARY, both["both"], RATE, noise, v0=[0.0, v0[SLIDING]])
    np.testing.assert_allclose(found.information.matrix, apart.matrix, rtol=1e-12)
    size = np.sqrt(np.diag(apart.matrix))
    np.testing.assert_allclose(
        found.roots[0].T @ found.roots[0] / np.outer(size, size),
        apart.matrix / np.outer(size, size),
        atol=1e-12,
    )


def test_limits_reject_and_say_why():
    given, v0, noise = candidates(ROTARY)
    found = rank_experiments(ROTARY, given, RATE, noise, v0=v0, limits={"x": 0.05, "u": 10.0})
    assert [one.name for one in found.entries] == ["presliding"]
    assert [one.name for one in found.rejected] == ["break_away", "sliding"]
    assert "position reaches" in found.rejected[0].sentence and "limit is 0.05" in found.rejected[0].sentence
    assert [one.name for one in found.plan(2)] == ["presliding", "presliding"]
    with pytest.raises(InputError, match=r"sliding is not allowed.*wider limit"):
        rank_experiments(ROTARY, given, RATE, noise, v0=v0, limits={"v": 1e-9, "u": 1e-9})


def test_strengths_and_words():
    given, v0, noise = candidates(ROTARY)
    drive = ROTARY.with_effects(effect("ConstantLoad"))
    found = rank_experiments(drive, given, RATE, noise, v0=v0, criterion="A", of=["load", "sigma2"])
    assert found.entries[-1].sentence.startswith("presliding lowers the mean variance of load, sigma2 by ")
    assert " force; not identifiable: sigma2." in found.entries[-1].sentence
    every = rank_experiments(drive, given, RATE, noise, v0=v0)
    sliding = next(one for one in every.entries if one.name == "sliding")
    assert "nats; least standard deviations: J to " in sliding.sentence and "sigma0" in sliding.sentence
    assert np.isinf(sliding.std["sigma0"])


def test_other_numbers_compile_nothing_and_progress_is_reported():
    given, v0, noise = candidates(ROTARY)
    rank_experiments(ROTARY, given, RATE, noise, v0=v0)
    before, reported = fisher._information._cached._cache_size(), []
    drive = PLANTS["stage"]
    given, v0, noise = candidates(drive)
    given["more"] = np.asarray(prbs(jax.random.key(7), N, RATE, 300.0, 0.01))
    rank_experiments(drive, given, RATE, noise, v0=[*v0, 0.0], progress=lambda *what: reported.append(what))
    assert fisher._information._cached._cache_size() == before
    assert [fraction for _, fraction in reported] == [0.25, 0.5, 0.75, 1.0] and "'sliding'" in reported[
        SLIDING
    ][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"candidates": {}}, "at least one name"),
        ({"candidates": [np.ones(N)]}, "Give a dict"),
        ({"candidates": {"short": np.ones(1)}}, "'short'.*n at least 2"),
        ({"candidates": {"gap": np.full(N, np.nan)}}, "'gap'.*not finite"),
        ({"candidates": {"none": []}}, "'none'.*no input"),
        ({"candidates": {"still": np.zeros(N)}}, "does not move"),
        ({"criterion": "E"}, 'Choose "D"'),
        ({"criterion": "parameter"}, "no parameter is asked for"),
        ({"criterion": "parameter", "of": "sigma3"}, "sigma3.*Name some of J"),
        ({"criterion": "parameter", "of": ("J", "J")}, "one twice"),
        ({"criterion": "A", "of": ()}, "names none"),
        ({"of": "J"}, "`of`.*counts all"),
        ({"free": ("J",), "criterion": "A", "of": "Fc"}, "Fc"),
        ({"limits": {"a": 1.0}}, "`limits`.*position"),
        ({"limits": {"x": -1.0}}, "`limits`.*positive"),
        ({"limits": {"x": np.nan}}, "`limits`.*positive"),
        ({"noise": 0.0}, "`noise`.*positive"),
        ({"substeps": "auto"}, "`substeps`.*whole number"),
        ({"known": "another"}, "`known`.*free"),
        ({"plan": 0}, "at least one experiment"),
    ],
)
def test_bad_input_is_a_sentence(change, words, monkeypatch):
    # Some of it is of a wrong type, also for a run in which types are checked.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    inputs, _, noise = plan(ROTARY)
    given = {"candidates": {"ramp": inputs[BREAK_AWAY]}, "noise": noise} | change
    if given.get("known") == "another":
        given["known"] = fisher_information(PLANTS["stage"], inputs[PRESLIDING], RATE, noise)
    steps = given.pop("plan", 1)
    with pytest.raises(InputError, match=words):
        rank_experiments(ROTARY, sample_rate=RATE, **given).plan(steps)
