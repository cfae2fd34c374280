"""Summaries: the statistics of scipy and of closed forms, and Monte Carlo errors as large as the scatter they state."""

import numpy as np
import pytest

from frictionjax import InputError, summarise
from frictionjax.core.frames import to_xarray

pytest.importorskip("xarray")


def results(values, failed=None, **more):
    """Results `value` over `cell` and `repeat`, with units and further results."""
    dims = ("cell", "repeat")
    cells, repeats = values.shape
    failed = np.zeros(values.shape, bool) if failed is None else failed
    arrays = {"value": (dims, values), "failed": (dims, failed)}
    arrays |= {name: (dims, np.broadcast_to(array, values.shape)) for name, array in more.items()}
    places = {"cell": np.arange(cells) * 2.0, "repeat": np.arange(repeats)}
    return to_xarray(arrays, places, {"value": "N", "cell": "m"}, about="it")


RNG = np.random.default_rng(7)


def test_the_numbers_are_those_of_numpy():
    values = RNG.normal(3.0, 2.0, (2, 50))
    found = summarise(results(values, value_true=2.5, value_stderr=2.0), quantiles=(0.25, 0.5))
    np.testing.assert_allclose(found["value_mean"], values.mean(axis=1), rtol=1e-13)
    np.testing.assert_allclose(found["value_std"], values.std(axis=1, ddof=1), rtol=1e-13)
    np.testing.assert_allclose(found["value_bias"], values.mean(axis=1) - 2.5, rtol=1e-12)
    np.testing.assert_allclose(found["value_rmse"], np.sqrt(np.mean((values - 2.5) ** 2, axis=1)), rtol=1e-13)
    np.testing.assert_allclose(found["value_quantile"], np.quantile(values, [0.25, 0.5], axis=1), rtol=1e-13)
    inside = np.abs(values - 2.5) <= 1.959963984540054 * 2.0
    np.testing.assert_allclose(found["value_coverage"], inside.mean(axis=1), rtol=1e-13)
    assert list(found["count"].values) == [50, 50] and not found["failed_rate"].any()
    assert found["value_bias"].dims == ("cell",) and found["value_quantile"].dims == ("quantile", "cell")
    assert found["value_bias_mcse"].attrs["units"] == "N" and found["value_coverage"].attrs["units"] == "1"
    assert list(found["cell"].values) == [0.0, 2.0] and found["cell"].attrs["units"] == "m"
    assert (
        found.attrs == {"about": "it"} and "value_true_mean" not in found and "value_stderr_mean" not in found
    )


def test_a_monte_carlo_error_is_the_scatter_of_its_statistic_over_repetitions():
    cells, n = 4000, 60
    values = RNG.normal(1.0, 2.0, (cells, n))
    positive = values > 0.0
    found = summarise(
        results(values, value_true=0.7, value_stderr=2.0, positive=positive), quantiles=(0.2, 0.5, 0.9)
    )
    for name in ("value_mean", "value_std", "value_bias", "value_rmse", "value_coverage", "positive_rate"):
        scatter = float(found[name].std())
        stated = float(np.sqrt((found[f"{name}_mcse"] ** 2).mean()))
        # The scatter of 4,000 cells is known to 1.1 %; the formulas are those of large n.
        assert stated == pytest.approx(scatter, rel=0.04), name
    for quantile in found["quantile"].values:
        own = found.sel(quantile=quantile)
        stated = float(np.sqrt((own["value_quantile_mcse"] ** 2).mean()))
        assert stated == pytest.approx(float(own["value_quantile"].std()), rel=0.15)


def test_failed_cases_and_what_is_not_finite_are_left_out():
    values = np.array([[1.0, 2.0, 3.0, np.inf, 100.0], [np.nan] * 5])
    failed = np.array([[False] * 4 + [True], [True] * 5])
    found = summarise(results(values, failed, good=values > 1.5))
    assert list(found["value_mean"].values[:1]) == [2.0] and np.isnan(found["value_mean"].values[1])
    assert (
        list(found["value_std"].values[:1]) == [1.0] and np.isnan(found["value_quantile"].values[:, 1]).all()
    )
    np.testing.assert_allclose(found["failed_rate"], [0.2, 1.0])
    assert list(found["count"].values) == [4, 0]
    np.testing.assert_allclose(found["good_rate"].values[0], 0.75)
    whole = summarise(results(values, failed), keep_failed=True)
    assert float(whole["value_mean"][0]) == 26.5 and list(whole["count"].values) == [5, 5]


def test_the_truth_may_be_a_number_a_coordinate_or_another_result():
    values = np.array([[1.0, 3.0], [2.0, 5.0]])
    for truth, bias in ((1.0, [1.0, 2.5]), ("cell", [2.0, 1.5]), ("other", [1.5, 2.5])):
        data = results(values, other=np.array([[0.0, 1.0], [1.0, 1.0]]))
        np.testing.assert_allclose(summarise(data, truth={"value": truth})["value_bias"], bias)


def test_everything_may_be_summarised_at_once():
    values = RNG.normal(size=(3, 40))
    found = summarise(results(values), over=("cell", "repeat"))
    np.testing.assert_allclose(found["value_mean"], values.mean())
    assert found["value_mean"].dims == () and int(found["count"]) == 120
    rows = summarise(results(values), over="cell")
    assert rows["value_mean"].dims == ("repeat",)


def test_one_case_has_a_mean_and_no_scatter():
    found = summarise(results(np.array([[4.0]]), value_true=3.0)).isel(cell=0)
    assert float(found["value_mean"]) == 4.0 and float(found["value_rmse"]) == 1.0
    for name in ("value_std", "value_mean_mcse", "value_rmse_mcse"):
        assert np.isnan(float(found[name])), name


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"over": "time"}, "there is no dimension `time`.*Choose from: cell, repeat"),
        ({"truth": {"none": 1.0}}, "there is no result `none`"),
        ({"truth": {"value": "none"}}, "there is no result `none`"),
        ({"level": 95.0}, "`level` is 95.0"),
        ({"quantiles": (2.0,)}, "`quantiles` are"),
    ],
)
def test_what_is_not_there_is_a_sentence(how, words):
    with pytest.raises(InputError, match=words):
        summarise(results(np.ones((2, 2))), **how)


def test_what_is_no_result_of_a_study_is_a_sentence():
    for wrong in (np.ones(3), to_xarray({"a": (("k",), [1.0])}, {})):
        with pytest.raises(InputError, match="is no result of a study"):
            summarise(wrong)
