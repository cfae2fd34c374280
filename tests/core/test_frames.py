"""Results as tables of pandas and data sets of xarray; and the sentence where these are not installed."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis

import frictionjax as fj
from frictionjax.core.frames import (
    estimate_columns,
    is_dataset,
    read_zarr,
    records,
    to_dataframe,
    to_xarray,
    write_zarr,
)

T = np.arange(40) / 100.0
PATH = fj.Trajectory(*(jnp.asarray(a) for a in (T, T**2, 2 * T, np.stack([T, -T], 1), np.sin(T), T)))
ONE = jnp.asarray(1.0)
FRF = fj.FRF(
    *(jnp.asarray(a) for a in (T, np.exp(1j * T), 0.9 + 0 * T, 0.1 + 0 * T)), 20.0 * ONE, 100.0 * ONE, ONE
)
ESTIMATES = {"Fc": fj.Estimate(1.0, 0.1, "N"), "vs": fj.Estimate(1e-3, float("inf"), "m/s", False)}
FIT = fj.FitResult(
    fj.Drive(1.0, fj.LuGre(1e5, 300.0, 0.4, 1.0, 1.5, 1e-3)), ESTIMATES, ("Fc", "vs"),
    np.array([[0.01, 0.002], [0.002, 0.04]]), np.eye(2), {}, 0.0, True, "The fit converged.", (),
)  # fmt: skip


def test_columns_of_estimates_and_records():
    assert estimate_columns(ESTIMATES) == {
        "parameter": ["Fc", "vs"],
        "value": [1.0, 1e-3],
        "stderr": [0.1, float("inf")],
        "unit": ["N", "m/s"],
        "identified": [True, False],
    }
    assert records([{"a": 1}, {"b": 2}]) == {"a": [1, None], "b": [None, 2]}
    assert records([]) == {}


@pytest.mark.parametrize(
    ("library", "make"),
    [
        ("pandas", lambda: to_dataframe({"a": [1.0]})),
        ("pandas", PATH.to_dataframe),
        ("xarray", lambda: to_xarray({"a": (("t",), [1.0])}, {"t": [0.0]})),
        ("xarray", PATH.to_xarray),
    ],
)
def test_a_missing_library_is_named_with_the_command_that_installs_it(library, make, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(
        ImportError, match=rf"needs {library}, .*python -m pip install 'frictionjax\[frames\]'"
    ):
        make()


@pytest.mark.parametrize("result", [PATH, FRF, FIT, fake_diagnosis(n=50)], ids=lambda r: type(r).__name__)
def test_every_result_becomes_a_table(result):
    pytest.importorskip("pandas")
    assert len(result.to_dataframe()) > 0


def test_tables_have_the_numbers_of_the_results_and_their_units():
    pytest.importorskip("pandas")
    frame = PATH.to_dataframe()
    np.testing.assert_array_equal(frame.index, T)
    np.testing.assert_array_equal(frame["z2"], -T)
    assert frame.attrs["units"]["v"] == "position/s"
    frame = FRF.to_dataframe()
    np.testing.assert_allclose(frame["phase"], T)
    np.testing.assert_allclose(frame["phase_std"], 0.1)
    assert FIT.to_dataframe().loc["Fc", "stderr"] == 0.1
    recording = fj.recording_from_frame(
        {"t": np.arange(200) / 1e3, "u": np.ones(200), "x": np.sin(np.arange(200.0))}
    )
    frame = fj.Case("c", fj.Plant(position_unit="rad"), (recording,)).recordings[0].to_dataframe()
    assert frame.attrs["units"]["x"] == "rad"
    np.testing.assert_array_equal(frame["x"], recording.x)


def test_a_store_of_zarr_keeps_numbers_texts_and_units(tmp_path):
    pytest.importorskip("zarr")
    arrays = {"a": (("k",), [1.0, np.nan]), "b": (("k",), np.array(["x", "longer"], dtype=object))}
    whole = to_xarray(arrays, {"k": [3, 4]}, {"a": "N"}, about={"of": [1, None]})
    write_zarr(whole, tmp_path / "s.zarr")
    found = read_zarr(tmp_path / "s.zarr")
    assert found.attrs == {"about": {"of": [1, None]}} and found["a"].attrs["units"] == "N"
    np.testing.assert_array_equal(found["a"], whole["a"])
    assert [str(text) for text in found["b"].values] == ["x", "longer"]
    assert is_dataset(found) and not is_dataset(found["a"])


def test_a_diagnosis_has_four_tables():
    pytest.importorskip("pandas")
    found = fake_diagnosis(n=50)
    assert found.to_dataframe().loc["maxwell_slip.share", "value"] == 0.42
    assert not found.to_dataframe("candidates").loc["backlash", "tested"]
    assert list(found.to_dataframe("mismatch")["axis"].unique()) == ["regime", "since_reversal", "dwell"]
    assert found.to_dataframe("errors").loc["holdout_stick", "noise_floor"] == 1.1e-7


@pytest.mark.untyped
def test_a_diagnosis_has_no_other_table():
    pytest.importorskip("pandas")
    found = fake_diagnosis(n=50)
    with pytest.raises(ValueError, match="must be one of: parameters, candidates, mismatch, errors"):
        found.to_dataframe("all")


def test_data_sets_keep_dimensions_and_units():
    pytest.importorskip("xarray")
    assert PATH.to_xarray()["z"].dims == ("t", "bristle")
    assert PATH.to_xarray()["x"].attrs["units"] == "position"
    assert FRF.to_xarray().attrs["sample_rate"] == 100.0
    covariance = FIT.to_xarray()["covariance"]
    assert float(covariance.sel(parameter="Fc", other="vs")) == 0.002
    found = fake_diagnosis(n=50)
    data = found.to_xarray("breakaway")
    assert data["residual_force"].attrs["units"] == "N*m"
    assert data["predicted_base"].attrs["units"] == "rad"
    np.testing.assert_array_equal(data["x"], found.recordings[1].x)
    with pytest.raises(fj.InputError, match=r"no recording 'x'.*Choose from noise_small"):
        found.to_xarray("x")


def test_results_show_their_numbers_in_a_screen():
    for result, words in (
        (PATH, "Trajectory of 40 samples"),
        (FRF, "FRF of 40 frequencies, 20 effective averages, 100 Hz"),
        (FIT, "Fc         1      0.1             N"),
        (fake_diagnosis(), "Diagnosis of arm-2024-03: named (maxwell_slip, confidence 0.98"),
    ):
        assert words in repr(result)
        assert len(repr(result)) < 2000
        assert result._repr_html_().startswith("<div><p><b>")


def test_results_show_themselves_inside_transformations():
    seen = []
    jax.jit(lambda path, frf: seen.extend((repr(path), repr(frf))))(PATH, FRF)
    assert "f64[40]" in seen[0]
    assert "f64[40]" in seen[1]
