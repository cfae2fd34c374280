"""What `.plot()` draws: the numbers of the result, with units on every axis, into new axes or the caller's own."""

import dataclasses

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis
from matplotlib.figure import Figure

import frictionjax as fj
from frictionjax.frequency.sanathanan_koerner import SKResult
from frictionjax.studies import EstimatorComparison, LevelSweep

UNITS = {"position": "m", "force": "N", "input": "V"}
DRIVE = fj.Drive(1.0, fj.LuGre(sigma0=1e5, sigma1=300.0, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3), 16.0)
T = np.arange(50) / 100.0
PATH = fj.Trajectory(
    *(jnp.asarray(a) for a in (T, 2e-3 * T, 2e-3 + 0.0 * T, T[:, None], np.sin(T), 2e-3 * T))
)
FREQUENCY = np.linspace(0.0, 50.0, 26)
RESPONSE = 1e-3 / (1.0 + 0.1j * FREQUENCY)
ONE = jnp.asarray(1.0)
FRF = fj.FRF(
    *(jnp.asarray(a) for a in (FREQUENCY, RESPONSE, np.full(26, 0.9), np.full(26, 1e-5))),
    20.0 * ONE,
    100.0 * ONE,
    ONE,
)
SK = SKResult(
    *(fj.Estimate(value, 0.1 * value, "1") for value in (1.0, 1e5, 300.0, 0.0, 20.0, 0.5)),
    FREQUENCY[1:], RESPONSE[1:], np.ones(3), 1.0, True, "Converged.", (), 1.1 * RESPONSE[1:], np.full(25, 1e-5),
)  # fmt: skip
NAMES = ("J", "Fc", "Fs", "vs")
SPREAD = np.array([0.01, 0.02, 0.03, 1e-5])
FIT = fj.FitResult(
    DRIVE,
    {n: fj.Estimate(1.0, s, {"vs": "m/s"}.get(n, "N")) for n, s in zip(NAMES, SPREAD.tolist(), strict=True)},
    NAMES, np.diag(SPREAD**2), np.diag(SPREAD**2), {}, 0.0, True, "The fit converged.", (),
)  # fmt: skip
PROFILE = fj.Profile("Fs", 1.5, 0.1, np.array([1.3, 1.7, 1.4]), np.array([4.0, 4.4, 1.0]), "N")
REFITS = np.random.default_rng(3).normal(size=(200, 2)) * [0.01, 1e-5] + [1.0, 1e-3]
BOOTSTRAP = fj.Bootstrap(("Fc", "vs"), REFITS, np.array([1.01, 1e-3]), ("N", "m/s"))
RECORDING = fj.Recording(
    "run_$1", 100.0, 0.02 * np.sin(T), 2e-2 * T, v=np.full(50, 2e-2), reference=2.1e-2 * T, simulated=1.9e-2 * T,
    temperature=20.0 + T, supply=np.full(50, 24.0), normal_force=np.full(50, 3.0),
)  # fmt: skip
IMPOSED = fj.Recording(
    "imposed", 100.0, np.zeros(50), 2e-2 * T, drive="motion", role="holdout", force=3.0 * np.sin(T)
)
CASE = fj.Case("bench", fj.Plant(16.0, "m", "N", "V"), [RECORDING, IMPOSED])
LEVELS = np.array([0.1, 0.3])
SWEEP = LevelSweep(
    LEVELS,
    ("prbs", "gaussian"),
    *[np.arange(12.0).reshape(2, 2, 3) + k for k in range(5)],
    9.0,
    (2.0, 5.0),
    (1.0, 2.0),
)


def _comparison():
    estimates = np.random.default_rng(0).normal(size=(4, 2, 5, 7))
    return EstimatorComparison(
        ("sk", "frf_ml", "breakaway", "joint"), ("J", "sigma0", "s", "sigma2", "Fc", "Fs", "vs"), ("1",) * 7,
        np.array([1e-9, 1e-8]), np.zeros(7), estimates, np.ones_like(estimates), np.ones((4, 2, 5), bool),
        np.ones((4, 2, 7)), dict.fromkeys(("sk", "frf_ml", "breakaway", "joint"), 1.0), 0.1,
    )  # fmt: skip


def _function(rng, level, kind="a", wide=0.0):
    return {
        "stiffness": level + rng.normal(),
        "rate": 2.0 * level,
        "found": rng.normal() > 0.0,
        "kind_of": kind,
    }


def _study(repeats=3, **axes):
    pytest.importorskip("zarr")
    design = fj.Factorial(*(fj.Axis(name, values) for name, values in axes.items()), repeats=repeats)
    return fj.run_study(
        fj.Study(design, fj.PythonTask(_function, units={"stiffness": "N/m"})), progress=False
    )


def _random():
    pytest.importorskip("zarr")
    design = fj.RandomDesign(fj.Axis("level", low=0.1, high=10.0, scale="log", unit="N"), cases=30)
    return fj.run_study(fj.Study(design, fj.PythonTask(_function)), progress=False)


RESULTS = {
    "trajectory": lambda: PATH,
    "frf": lambda: FRF,
    "second order": lambda: SK,
    "fit": lambda: FIT,
    "profile": lambda: PROFILE,
    "bootstrap": lambda: BOOTSTRAP,
    "recording": lambda: RECORDING,
    "case": lambda: CASE,
    "named": fake_diagnosis,
    "adequate": adequate_diagnosis,
    "sweep": lambda: SWEEP,
    "estimators": _comparison,
}
WITHOUT_UNIT = {"coherence", "deviance (the line: 95 %)", ""}
RATIOS = {
    "error power over the noise floor",
    "scatter over the bound",
    "rms of the excitation over break-away",
}


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_is_drawn_with_units_on_every_axis(name):
    result = RESULTS[name]()
    panels = result.plot(units=UNITS)
    figure = panels[0].figure
    if name == "named":
        figure.canvas.draw()
    assert figure.axes == list(panels)
    for panel in panels:
        assert panel.lines or panel.collections or panel.patches or panel.images
        shared = [
            other for other in panels if other is not panel and panel.get_shared_x_axes().joined(panel, other)
        ]
        if not panel.images:
            assert panel.get_xlabel() or any(other.get_xlabel() for other in shared)
        for label in (panel.get_xlabel(), panel.get_ylabel()):
            assert "(" in label or label in WITHOUT_UNIT | RATIOS, label


@pytest.mark.parametrize("name", ["trajectory", "fit", "named"])
def test_a_result_is_drawn_into_the_callers_axes(name):
    result = RESULTS[name]()
    _, own = plt.subplots(1, 3)
    assert result.plot(axes=own) == tuple(own)
    with pytest.raises(fj.InputError, match=r"there are 1 axes for 3 panels.*Give one for each of"):
        result.plot(axes=own[0])


def test_curves_are_those_of_the_result():
    x = PATH.plot(units=UNITS)[0]
    np.testing.assert_allclose(x.lines[0].get_ydata(), 2e3 * T, atol=1e-9)
    assert x.get_ylabel() == "position (µm)"
    magnitude, phase, coherence = FRF.plot()
    np.testing.assert_allclose(magnitude.lines[0].get_ydata(), np.abs(RESPONSE[1:]))
    np.testing.assert_allclose(phase.lines[0].get_ydata(), np.degrees(np.angle(RESPONSE[1:])))
    assert magnitude.get_ylabel() == "magnitude (position units/input units)"
    np.testing.assert_allclose(coherence.lines[0].get_ydata(), 0.9)
    measured, fitted = SK.plot()[0].lines[:2]
    np.testing.assert_allclose(measured.get_ydata(), 1.1 * fitted.get_ydata())


def test_a_fit_shows_its_friction_its_loops_and_its_correlations():
    stribeck, loops, correlation = FIT.plot()
    v, force = stribeck.lines[0].get_data()
    friction = DRIVE.friction
    np.testing.assert_allclose(force, np.asarray(friction.level(v)) + 0.4 * v)
    (band,) = stribeck.collections
    path = band.get_paths()[0].vertices
    at_rest = path[np.isclose(path[:, 0], v[0])]
    # Where sliding begins, the friction is Fs and so is its standard error.
    assert np.ptp(at_rest[:, 1]) == pytest.approx(2.0 * 1.96 * 0.03, rel=1e-2)
    largest = loops.lines[-1]
    x, loop = largest.get_data()
    assert np.max(x) == pytest.approx(15.0)  # µm, 1.5 N over 1e5 N/m
    assert loops.get_xlabel() == "displacement (µm)"
    assert loop[0] == pytest.approx(loop[-1], rel=1e-3)  # a closed loop
    np.testing.assert_allclose(correlation.images[0].get_array(), np.eye(4))


def test_two_directions_and_unknown_errors_are_drawn_as_they_are():
    asymmetric = DRIVE.with_effects(fj.catalogue()["direction_asymmetry"][0]())
    strengths = {p.name: jnp.asarray(0.2) for p in asymmetric.effects[0].strengths}
    effect = dataclasses.replace(asymmetric.effects[0], **strengths)
    drive = dataclasses.replace(asymmetric, effects=(effect,))
    stribeck = dataclasses.replace(FIT, drive=drive, covariance=np.full((4, 4), np.inf)).plot()[0]
    assert [line.get_label() for line in stribeck.lines] == ["forward", "backward"]
    assert not stribeck.collections


def test_a_diagnosis_shows_the_recording_and_the_place_of_the_largest_mismatch():
    found = fake_diagnosis()
    error, where, force = found.plot()
    assert "holdout_stick (held out)" in error.get_title()
    assert error.get_ylabel() == "position error, 0.1 s ahead (µrad)"
    assert force.get_ylabel() == "residual force (mN·m)"
    assert where.get_title() == "where the mismatch is: since reversal"
    assert max(patch.get_width() for patch in where.patches) == 12.0
    labels = [text.get_text() for text in error.get_legend().get_texts()]
    assert labels == ["base model: 665 nrad rms", "extended model: 102 nrad rms"]
    assert len(adequate_diagnosis().plot()) == 2
    better = dataclasses.replace(
        found.recordings[1], role="holdout", name="better", prediction_rmse_extended=1e-9
    )
    low = dataclasses.replace(found.mismatch[0], axis="frequency", excess=1e9)
    high = dataclasses.replace(low, excess=1.0)
    changed = (*found.mismatch, low, high)
    both = dataclasses.replace(found, recordings=(*found.recordings, better), mismatch=changed).plot()
    assert "better (held out)" in both[0].get_title()
    assert both[1].get_title() == "where the mismatch is: since reversal"
    with pytest.raises(fj.InputError, match="has no recordings"):
        dataclasses.replace(found, recordings=()).plot()


def test_a_study_is_drawn_over_any_two_dimensions():
    study = _study(level=[0.1, 1.0, 10.0], kind=["a", "b"], wide=[float(k) for k in range(9)])
    stiffness, rate, found = fj.plot(study, names=("stiffness", "rate", "found"))
    assert stiffness.get_xscale() == "log" and stiffness.get_ylabel() == "stiffness (N/m)"
    np.testing.assert_allclose(rate.lines[0].get_ydata(), [0.2, 2.0, 20.0])
    assert [text.get_text() for text in stiffness.get_legend().get_texts()] == ["kind = a", "kind = b"]
    summary = fj.summarise(study, over=("repeat", "wide"))
    line, bars = stiffness.containers[0].lines[0], stiffness.containers[0].lines[2][0]
    mean, error = (summary[f"stiffness_mean{end}"].sel(kind="a").values for end in ("", "_mcse"))
    np.testing.assert_allclose(line.get_ydata(), mean)
    np.testing.assert_allclose([np.ptp(bar[:, 1]) for bar in bars.get_segments()], 2.0 * error)
    assert 0.0 < np.asarray(found.lines[0].get_ydata()).mean() < 1.0
    (words,) = fj.plot(study, over="kind", names="rate")
    assert [text.get_text() for text in words.get_xticklabels()] == ["a", "b"]
    (image,) = fj.plot(study, over=("level", "wide"), names="rate")
    np.testing.assert_allclose(image.collections[0].get_array().reshape(9, 3)[4], [0.2, 2.0, 20.0])
    assert image.get_ylabel() == "wide"


def test_a_summary_is_drawn_as_it_is_and_further_dimensions_are_refused():
    summary = fj.summarise(_study(level=[0.1, 1.0], kind=["a", "b"], wide=[0.0, 1.0]))
    with pytest.raises(fj.InputError, match=r"`rate_mean` has the further dimensions wide.*dataset\.sel"):
        fj.plot(summary, names="rate_mean")
    (drawn,) = fj.plot(summary.sel(wide=1.0), names="rate_mean")
    assert drawn.get_ylabel() == "mean of rate"
    np.testing.assert_allclose(drawn.lines[0].get_ydata(), [0.2, 2.0])
    with pytest.raises(fj.InputError, match="there is no `nothing`"):
        fj.plot(summary, over="nothing")
    with pytest.raises(fj.InputError, match="a FRF has one picture"):
        fj.plot(FRF, over="frequency")


def test_the_cases_of_a_random_design_are_points():
    study = _random()
    (rate,) = fj.plot(study, names="rate")
    assert rate.get_xlabel() == "level (N)" and rate.get_xscale() == "log"
    np.testing.assert_allclose(rate.lines[0].get_ydata(), 2.0 * study["level"].values)
    (coloured,) = fj.plot(study, over=("level", "case"), names="rate")
    np.testing.assert_allclose(coloured.collections[0].get_array(), np.arange(30))


def test_a_profile_shows_the_estimate_and_its_interval():
    (panel,) = PROFILE.plot()
    np.testing.assert_allclose(panel.lines[0].get_data(), [[1.3, 1.4, 1.5, 1.7], [4.0, 1.0, 0.0, 4.4]])
    ends = sorted(line.get_xdata()[0] for line in panel.lines[3:])
    np.testing.assert_allclose(ends, PROFILE.interval())
    assert panel.get_xlabel() == "Fs (N)"


def test_a_profile_is_an_xarray_dataset_over_its_parameter():
    pytest.importorskip("xarray")
    found = PROFILE.to_xarray()
    np.testing.assert_allclose(found["deviance"].sel(Fs=1.7), 4.4)
    assert found["deviance"].dims == ("Fs",) and found["Fs"].attrs["units"] == "N"
    assert found.attrs == {"value": 1.5, "stderr": 0.1}


def test_a_bootstrap_shows_its_refits_the_estimate_and_the_interval():
    coulomb, stribeck = BOOTSTRAP.plot()
    heights = sum(patch.get_height() for patch in coulomb.patches)
    assert heights == 200
    assert sorted(line.get_xdata()[0] for line in coulomb.lines[:3]) == pytest.approx(
        sorted([1.01, *BOOTSTRAP.interval("Fc")])
    )
    assert coulomb.get_xlabel() == "Fc (N)" and stribeck.get_xlabel() == "vs (m/s)"
    nameless = dataclasses.replace(BOOTSTRAP, units=())
    assert [panel.get_xlabel() for panel in nameless.plot(units={"Fc": "mN"})] == ["Fc (mN)", "vs (vs units)"]
    assert "unit" in repr(BOOTSTRAP) and "unit" not in repr(nameless)
    with pytest.raises(fj.InputError, match="no refit of `Fc` is finite"):
        dataclasses.replace(BOOTSTRAP, values=np.full((3, 2), np.nan)).plot()


def test_a_recording_shows_every_channel_in_the_units_of_its_plant():
    panels = RECORDING.plot(units=UNITS)
    labels = [panel.get_ylabel() for panel in panels]
    assert labels == [
        *("position (mm)", "velocity (m/s)", "input (mV)"),
        *("temperature (K or °C)", "normal force (unit of the file)", "supply (unit of the file)"),
    ]
    measured, reference, simulated = panels[0].lines
    np.testing.assert_allclose(measured.get_ydata(), 20.0 * T)
    np.testing.assert_allclose(reference.get_ydata(), 21.0 * T)
    np.testing.assert_allclose(simulated.get_ydata(), 19.0 * T)
    assert panels[0].get_title() == r"run_\$1, fitted"
    assert "position units" in RECORDING.plot()[0].get_ylabel()
    x, force = CASE.recordings[1].plot()  # no input where the motion is imposed
    assert x.get_ylabel() == "position (mm)" and force.get_ylabel() == "force (N)"
    pushed = dataclasses.replace(CASE.recordings[1], simulated=0.5 * np.sin(T))
    np.testing.assert_allclose(pushed.plot()[1].lines[1].get_ydata(), 0.5 * np.sin(T))


def test_a_case_shows_position_and_cause_of_each_recording():
    panels = CASE.plot()
    assert [panel.get_ylabel() for panel in panels] == [
        *("position (mm)", "input (mV)", "position (mm)", "force (N)")
    ]
    assert [panel.get_title("left") for panel in panels[::2]] == [r"run_\$1, fitted", "imposed, held out"]
    many = fj.Case("many", CASE.plant, [dataclasses.replace(IMPOSED, name=f"r{k}") for k in range(10)])
    drawn = many.plot()
    assert len(drawn) == 16 and drawn[0].figure.get_supxlabel() == "and 2 more recordings"
    own = Figure().subplots(2, 2)
    assert CASE.plot(axes=own) == tuple(own.ravel())
    with pytest.raises(fj.InputError, match="the case has no recordings"):
        fj.Case("none", CASE.plant, []).plot()


@pytest.mark.parametrize("result", [DRIVE, 3, None])
def test_what_has_no_picture_is_refused(result):
    with pytest.raises(fj.InputError, match=r"has no picture\. Give one of: Trajectory, FRF"):
        fj.plot(result)


@pytest.mark.parametrize("result", [PATH, FRF])
def test_a_batch_is_refused_with_how_to_draw_one(result):
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), result)
    with pytest.raises(fj.InputError, match=r"is a batch of shape \(2,\).*leaf\[i\]"):
        batch.plot()


def test_a_first_picture_leaves_pyplot_as_interactive_as_it_was(monkeypatch):
    """In a notebook the first figure makes pyplot interactive, and without that no later one is shown."""
    plt.ioff()
    figure = plt.figure

    def first(*args, **kwargs):
        plt.ion()
        return figure(*args, **kwargs)

    monkeypatch.setattr(plt, "figure", first)
    PATH.plot()
    interactive = plt.isinteractive()
    plt.ioff()
    assert interactive


def test_a_picture_that_fails_leaves_no_figure():
    with pytest.raises(fj.InputError):
        jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), PATH).plot()
    assert plt.get_fignums() == []
