"""Designs: which cases there are, in which order, with which values; and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax import Axis, Factorial, InputError, PythonTask, RandomDesign, SobolDesign, Study
from frictionjax.studies.design import digest
from frictionjax.studies.study import Blocks

NOISE = Axis("noise", low=1e-8, high=1e-4, scale="log", count=3, unit="m")
KIND = Axis("kind", ["a", "b"])


def _any(rng, **case):
    return {}


def test_a_factorial_design_has_every_combination_the_repeat_fastest():
    design = Factorial(NOISE, KIND, repeats=2)
    assert design.shape == {"noise": 3, "kind": 2, "repeat": 2} and design.size == 12
    cases = design.table().take(np.arange(12))
    np.testing.assert_allclose(cases["noise"], np.repeat([1e-8, 1e-6, 1e-4], 4), rtol=1e-14)
    assert cases["noise"][0] == 1e-8 and cases["noise"][-1] == 1e-4
    assert list(cases["kind"]) == ["a", "a", "b", "b"] * 3
    assert list(design.table().take(np.array([7, 2]))["kind"]) == ["b", "b"]


def test_all_combinations_may_share_their_draws():
    places = np.arange(12)
    assert list(Factorial(NOISE, KIND, repeats=2).streams(places)) == list(places)
    assert list(Factorial(NOISE, KIND, repeats=2, same_draws=True).streams(places)) == [0, 1] * 6


@pytest.mark.parametrize("kind", [RandomDesign, SobolDesign])
def test_a_design_fills_its_ranges(kind):
    axes = (NOISE, KIND, Axis("load", low=-1.0, high=3.0), Axis("J", low=1.0, high=3.0, scale="normal"))
    table = kind(*axes, cases=256, design_seed=4).table().take(np.arange(256))
    assert np.all((table["noise"] >= 1e-8) & (table["noise"] <= 1e-4))
    assert np.all((table["load"] >= -1.0) & (table["load"] <= 3.0))
    # By the standard error of a random design; that of Sobol is smaller.
    assert abs(np.mean(np.log10(table["noise"])) + 6.0) < 5 * 4.0 / np.sqrt(12 * 256)
    assert abs(np.mean(table["load"]) - 1.0) < 5 * 4.0 / np.sqrt(12 * 256)
    assert abs(np.mean(table["kind"] == "a") - 0.5) < 5 * 0.5 / 16
    inside = np.mean((table["J"] > 1.0) & (table["J"] < 3.0))
    assert abs(inside - 0.95) < 5 * np.sqrt(0.95 * 0.05 / 256)


def test_a_sobol_design_is_more_even_than_a_random_one():
    axes = (Axis("a", low=0.0, high=1.0), Axis("b", low=0.0, high=1.0))

    def mean(kind, seed):
        return np.mean(kind(*axes, cases=128, design_seed=seed).table().take(np.arange(128))["b"])

    means = {k: [abs(mean(k, seed) - 0.5) for seed in range(8)] for k in (RandomDesign, SobolDesign)}
    assert np.max(means[SobolDesign]) < 0.2 * np.median(means[RandomDesign])


def test_a_longer_random_design_begins_with_the_shorter_one():
    short, long = (RandomDesign(NOISE, KIND, cases=n).table().take(np.arange(5)) for n in (5, 50))
    np.testing.assert_array_equal(short["noise"], long["noise"])
    assert digest(RandomDesign(NOISE, cases=5)) != digest(RandomDesign(NOISE, cases=5, design_seed=1))


@settings(max_examples=40)
@given(
    texts=st.lists(st.sampled_from("abc"), unique=True, min_size=1),
    numbers=st.integers(1, 5),
    repeats=st.integers(1, 7),
    lanes=st.integers(1, 9),
)
def test_blocks_hold_every_case_once_and_one_text_each(texts, numbers, repeats, lanes):
    design = Factorial(Axis("n", range(numbers)), Axis("kind", texts), repeats=repeats)
    study = Study(design, PythonTask(_any))
    wide = type("Wide", (PythonTask,), {"lanes": lanes})(_any)
    object.__setattr__(study, "task", wide)
    blocks = Blocks(study)
    whole = blocks.places(np.arange(len(blocks)))
    assert sorted(whole) == list(range(design.size))
    assert list(blocks.sizes()) == [len(block.places) for block in blocks.take(np.arange(len(blocks)))]
    for block in blocks.take(np.arange(len(blocks))):
        assert len(block.places) <= lanes
        assert lanes == 1 or len(set(block.columns["kind"])) == 1
    done = np.zeros(design.size, bool)
    done[blocks.places(np.array([0]))] = True
    assert list(blocks.unfinished(done)) == list(range(1, len(blocks)))


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Axis("two words", [1]), "axis `two words`: it cannot be used as a name. Use letters"),
        (lambda: Axis("repeat", [1]), "and none of key, rng, case, repeat"),
        (lambda: Axis("a"), "axis `a`: it has no values. Give `values`, or `low` and `high`"),
        (lambda: Axis("a", [1.0, "x"]), "of several kinds"),
        (lambda: Axis("a", [1.0, np.nan]), "of several kinds"),
        (lambda: Axis("a", [1.0, 1.0]), "a value occurs twice. Repeat cases by `repeats`"),
        (lambda: Axis("a", [1.0], low=0.0), "values and a range"),
        (lambda: Axis("a", low=2.0, high=1.0), "its range is from 2.0 to 1.0"),
        (lambda: Axis("a", low=0.0, high=1.0, scale="log"), "begins at 0.0"),
        (lambda: Axis("a", low=0.0, high=1.0, scale="cubic"), "`scale` is 'cubic'"),
        (lambda: Axis("a", low=0.0, high=1.0, count=1), "`count` is 1"),
        (lambda: Factorial(Axis("a", low=0.0, high=1.0)), "a factorial design needs to know its values"),
        (lambda: Factorial(NOISE, NOISE), "two axes `noise`"),
        (lambda: Factorial(NOISE, repeats=0), "`repeats` is 0"),
        (lambda: Factorial([1.0]), "argument 1 is a list"),
        (lambda: Factorial(Axis("a", range(2**16)), Axis("b", range(2**16))), "a study at most 4294967295"),
        (lambda: RandomDesign(cases=3), "there is no axis"),
        (lambda: SobolDesign(NOISE, cases=True), "`cases` is True"),
        (lambda: Study(Factorial(NOISE), PythonTask(_any), seed=-1), "`seed` is -1"),
        (lambda: Study([], PythonTask(_any)), "a list is no design"),
        (lambda: Study(Factorial(NOISE), 3), "int is no task"),
        (lambda: Study(Factorial(NOISE), lambda key: {}), "with the axes of the design.*Let it take key, noise"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()
