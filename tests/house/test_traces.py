"""Trace once: a verb does not trace or compile again because a number is another one, only for another shape."""

import functools
import inspect
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis
from helpers_estimation import FINE, PLANT, small_case
from helpers_plants import STRENGTHS, TABLE_I, effect, with_every_effect
from helpers_recordings import toml
from helpers_studies import kept_study, run_scaled
from helpers_traces import (
    arms,
    calibration,
    columns,
    configured,
    information,
    loaded,
    programs,
    recordings,
    saved_diagnosis,
    saved_fit,
    start,
    unwarmed,
)
from scipy.signal import lfilter

import frictionjax.api as api
from frictionjax import excitation
from frictionjax.core import FrictionjaxWarning
from frictionjax.diagnosis.screening import try_catalogue
from frictionjax.estimation.parameters import base_layout
from frictionjax.physics import Drive, LuGre, catalogue
from frictionjax.simulation import observer_gains, predict_ahead, simulate_reference

FRICTION = LuGre(sigma0=1.2e5, sigma1=300.0, sigma2=0.5, Fc=1.1, Fs=1.4, vs=2e-3)
OTHER = Drive(J=2.0, friction=FRICTION, motor_constant=3)
DRIVES = (TABLE_I, OTHER)
RATES = (2000.0, 1000)  # a whole number is a number too
Call = Callable[[], object]


def _noise(k, n, seed=0):
    return np.random.default_rng([k, seed]).standard_normal(n)


def _simulate(k) -> Call:
    u = _noise(k, 301)
    return lambda: api.simulate(DRIVES[k], u, RATES[k], x0=1e-6 * k, v0=0.1 * k, z0=k)


def _simulate_with_every_effect(k) -> Call:
    drive, u = with_every_effect(DRIVES[k], np.full(len(STRENGTHS), 0.01 * (k + 1))), _noise(k, 302)
    return lambda: api.simulate(drive, u, RATES[k])


def _simulate_to_a_tolerance(k) -> Call:
    u = 0.1 * _noise(k, 303)
    return lambda: api.simulate(TABLE_I, u, RATES[0], substeps="auto", tolerance=1e-6 * (1 + k))


def _simulate_closed_loop(k) -> Call:
    law = api.Controller(kp=10.0 + k, kd=0.1, limit=5.0 + k)
    return lambda: api.simulate_closed_loop(DRIVES[k], 1e-6 * _noise(k, 315), RATES[k], law)


def _simulate_batch(k) -> Call:
    """Four drives at once: masses and starts of their own, one input."""
    drive, u = DRIVES[k], _noise(k, 304)
    drives = Drive(drive.J * np.linspace(1.0, 2.0 + k, 4), drive.friction, drive.motor_constant)
    return lambda: api.simulate_batch(drives, u, RATES[k], x0=1e-6 * np.arange(4.0), v0=0.1 * k)


def _simulate_reference(k) -> Call:
    u = 0.1 * _noise(k, 31)
    return lambda: simulate_reference(DRIVES[k], u, RATES[k], x0=1e-6 * k, rtol=1e-6 * (1 + k), atol=1e-9)


def _predict_ahead(k) -> Call:
    force, x, dt = _noise(k, 305), 1e-5 * _noise(k, 305, 1), 1.0 / RATES[k]
    gains = observer_gains(50.0 + 10.0 * k, dt)
    first = (1e-6 * k, 0.1 * k, 0.0)
    return lambda: predict_ahead(DRIVES[k], force, x, dt, gains, first, horizon=20, stride=5)


def _linearize(k) -> Call:
    return lambda: api.linearize(DRIVES[k], x=1e-3 * k, z=1e-6 * k)


def _estimate_frf(k) -> Call:
    u, x = _noise(k, 3001), _noise(k, 3001, 1)
    return lambda: api.estimate_frf(u, x, RATES[k], segment=250)


def _fit_sk(k, **settings) -> Call:
    u = _noise(k, 4001)
    x = lfilter([1e-3 * (1 + k)], [1.0, -1.5, 0.7], u) + 1e-5 * _noise(k, 4001, 1)
    frf = api.estimate_frf(u, x, RATES[k], segment=256)
    # Another band of fewer than 256 bins is another number, too.
    return lambda: api.fit_sk(frf, ((3.0, 150.0), (3.0, 120.0))[k], motor_constant=1.0 + k, **settings)


def _best_linear_approximation(k) -> Call:
    lines = excitation.multisine_lines(jax.random.key(0), 254, 1000.0, (3.0, 100.0))
    keys = [jax.random.key(10 * k + i) for i in range(2)]
    u = np.stack([np.tile(excitation.multisine(key, 254, 1000.0, lines.frequency, 1.0), 4) for key in keys])
    x = 0.1 * u + 1e-3 * _noise(k, u.shape)

    def call():
        found = api.best_linear_approximation(u, x, RATES[k], period=254, lines=lines)
        return found, found.frf(), found.nonlinear_variance, found.odd.p_value, found.even.distortion

    return call


def _prbs(k) -> Call:
    rate, bandwidth = ((2000.0, 400.0), (1000.0, 200.0))[k]
    return lambda: excitation.prbs(jax.random.key(k), 307, rate, bandwidth, 1.0 + k)


def _gaussian_noise(k) -> Call:
    rate, band = ((2000.0, 400.0), (1000.0, 130.0))[k]
    return lambda: excitation.gaussian_noise(jax.random.key(k), 308, rate, band, 1.0 + k, low=3.0 * k)


def _multisine(k) -> Call:
    rate, band = ((2000.0, (10.0, 400.0)), (1000.0, (5.0, 200.0)))[k]
    return lambda: excitation.multisine(jax.random.key(k), 309, rate, band, 1.0 + k)


def _multisine_lines(k) -> Call:
    rate, band = ((2000.0, (10.0, 400.0)), (1000.0, (5.0, 200.0)))[k]
    return lambda: excitation.multisine_lines(jax.random.key(k), 310, rate, band, group=3).excited


def _ramp(k) -> Call:
    # The level as the noise verbs have it, from a computation: a Python number would not even be traced.
    return lambda: excitation.ramp(311, RATES[k], TABLE_I.friction.Fs * (1.0 + k), rest=0.01 * k)


def _presliding_loop(k) -> Call:
    level, nested = TABLE_I.friction.Fs * (0.5 + 0.1 * k), ((0.5, 0.3), (0.6, 0.2))[k]
    return lambda: excitation.presliding_loop(312, RATES[k], level, nested=nested)


def _point_to_point(k) -> Call:
    positions, times = ([0.1, 0.2], [0.3, -0.1])[k], 0.02 * (1 + k)
    return lambda: excitation.point_to_point(313, RATES[k], positions, times, rests=0.5 * times)


def _level_sweep(k) -> Call:
    """Other numbers; another sample rate is another structure: it says which bins lie in a band."""
    bands = {"bandwidth": 200.0, "band": (3.0, 150.0), "low_band": (3.0, 20.0), "sample_rate": 2000.0}
    sizes = {"seeds": 2, "averages": 3, "segment": 1000}
    return lambda: (
        api.level_sweep(DRIVES[k], levels=((0.05, 0.3), (0.1, 0.2))[k], seed=k, **sizes, **bands).stiffness
    )


def _compare_estimators(k) -> Call:
    return lambda: (
        api.compare_estimators(
            draws=3, levels=((1e-3,), (2e-3,))[k], excitation=0.1 + 0.02 * k, seed=k
        ).estimates
    )


def _fit(k) -> Call:
    others = (
        recordings(0),
        recordings(1),
        recordings(1, prefix="another"),
        recordings(1, samples=1190),
        recordings(1, rate=2002.0),
    )
    drive, step = start(1.0 if k == 0 else 1.2), FINE if k == 0 else 2.0 * FINE
    return lambda: api.fit(drive, others[k], encoder_step=step)


def _fit_with_an_effect(k) -> Call:
    """1: other numbers; 2: on a plant of another size."""
    seen = recordings(min(k, 1), load=0.05)
    return lambda: api.fit(loaded(1.0), seen, encoder_step=FINE, scales={"Fc": (0.5, 0.5, 0.6)[k]})


def _fit_many(k) -> Call:
    sets = [recordings(2 * k), recordings(2 * k + 1)]
    return lambda: api.fit_many(start(1.0 + 0.1 * k), sets, encoder_step=FINE)


@functools.cache
def _fitted():
    """One fit for all who start from a result."""
    return api.fit(start(1.0), recordings(0), encoder_step=FINE, own_starts=False)


def _profile_likelihood(k) -> Call:
    result, name = _fitted(), ("J", "sigma0")[k]
    return lambda: api.profile_likelihood(result, name).deviance


def _bootstrap(k) -> Call:
    result = _fitted()
    return lambda: api.bootstrap(result, 4, jax.random.key(k)).values


def _simulate_imposed(k) -> Call:
    x = 1e-5 * np.cumsum(_noise(k, 314))
    return lambda: api.simulate_imposed(DRIVES[k], x, RATES[k], z0=1e-6 * k)


def _fisher_information(k) -> Call:
    u = _noise(k, 315)
    return lambda: api.fisher_information(DRIVES[k], u, RATES[k], 1e-6 * (1 + k)).matrix


def _rank_experiments(k) -> Call:
    candidates = {"noise": _noise(k, 316), "more": 2.0 * _noise(k, 316, 1)}
    return lambda: api.rank_experiments(DRIVES[k], candidates, RATES[k], 1e-6 * (1 + k)).best


def _rank_for_discrimination(k) -> Call:
    load, asymmetry = effect("ConstantLoad", load=0.1 + 0.01 * k), effect("ViscousAsymmetry", viscous=0.1)
    candidates = {"noise": _noise(k, 317), "more": 2.0 * _noise(k, 317, 1)}
    return lambda: (
        api.rank_for_discrimination(DRIVES[k], load, asymmetry, candidates, RATES[k], 1e-6 * (1 + k)).best
    )


def _optimise_multisine(k) -> Call:
    u = excitation.multisine(jax.random.key(k), 318, RATES[0], (10.0, 400.0), 0.1 + 0.01 * k)
    return lambda: api.optimise_multisine(DRIVES[k], u, RATES[0], 1e-6 * (1 + k), steps=2).amplitudes


def _diagnose(k) -> Call:
    """With one effect in place of the whole catalogue. It is named both times: another course needs other programs."""
    drive = PLANT.with_effects(effect("ConstantLoad", load=(0.06, 0.065)[k]))
    seen = small_case(drive=drive, seed=k, seconds=2.4)

    def call():
        with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as executor:
            patch.setattr(try_catalogue, "catalogue", lambda: {"constant_load": catalogue()["constant_load"]})
            found = api.diagnose(seen, executor=executor)
        assert [missing.effect for missing in found.missing] == ["constant_load"]

    return call


class Traced(NamedTuple):
    """A public verb: `prepare(0)` gives its first call, `prepare(1)`, ... the others, each with a word."""

    verb: str
    prepare: Callable[[int], Call]
    others: tuple[str, ...] = ("numbers",)
    slow: bool = False


TRACED = (
    Traced("simulate", _simulate),
    Traced("simulate", _simulate_with_every_effect, ("numbers_of_effects",)),
    Traced("simulate", _simulate_to_a_tolerance, ("tolerance",)),
    Traced("simulate_closed_loop", _simulate_closed_loop),
    Traced("simulate_batch", _simulate_batch),
    Traced("simulation.simulate_reference", _simulate_reference),
    Traced("simulation.predict_ahead", _predict_ahead),
    Traced("linearize", _linearize),
    Traced("estimate_frf", _estimate_frf),
    Traced("fit_sk", _fit_sk),
    Traced("fit_sk", functools.partial(_fit_sk, fit_delay=True), ("numbers_with_delay",)),
    Traced("best_linear_approximation", _best_linear_approximation),
    Traced("excitation.prbs", _prbs),
    Traced("excitation.gaussian_noise", _gaussian_noise),
    Traced("excitation.multisine", _multisine),
    Traced("excitation.multisine_lines", _multisine_lines),
    Traced("excitation.ramp", _ramp),
    Traced("excitation.presliding_loop", _presliding_loop),
    Traced("excitation.point_to_point", _point_to_point),
    Traced("level_sweep", _level_sweep, ("numbers",)),
    Traced("run_study", run_scaled),
    Traced("compare_estimators", _compare_estimators, slow=True),
    Traced("fit", _fit, ("numbers", "names", "lengths", "sample_rate")),
    Traced("fit", _fit_with_an_effect, ("numbers_with_effect", "scale_of_effect"), slow=True),
    Traced("fit_many", _fit_many, slow=True),
    Traced("profile_likelihood", _profile_likelihood, ("parameter",), slow=True),
    Traced("bootstrap", _bootstrap, ("key",), slow=True),
    Traced("simulate_imposed", _simulate_imposed),
    Traced("fisher_information", _fisher_information),
    Traced("rank_experiments", _rank_experiments),
    Traced("rank_for_discrimination", _rank_for_discrimination, slow=True),
    Traced("optimise_multisine", _optimise_multisine, slow=True),
    Traced("diagnose", _diagnose, slow=True),
)

RECORDING = api.Recording("run", 1000.0, *np.random.default_rng(0).standard_normal((2, 400)))


def _held_out():
    with pytest.warns(FrictionjaxWarning, match="last third"):
        api.hold_out_last_third(api.Case("one", api.Plant(), (RECORDING,)))


UNTRACED: dict[str, tuple[str, Callable]] = {
    "audit": ("numpy on one recording", lambda folder: api.audit(RECORDING, api.Plant())),
    "case_from_files": (
        "reads files",
        lambda folder: api.case_from_files(toml(folder) and folder / "run.csv", folder / "kept.csv"),
    ),
    "catalogue": ("lists classes", lambda folder: api.catalogue()),
    "configure_jax": ("sets JAX up", lambda folder: configured()),
    "excitation.silent_lines": (
        "whole numbers only",
        lambda _: excitation.silent_lines(np.array([3, 5, 9]), 1.0),
    ),
    "extrapolate_to_zero_amplitude": (
        "a handful of small least squares, in numpy",
        lambda folder: api.extrapolate_to_zero_amplitude([0.1, 0.2, 0.3], [9.0, 8.0, 7.0], [0.1, 0.1, 0.1]),
    ),
    "hold_out_last_third": ("cuts a recording", lambda folder: _held_out()),
    "identifiability": ("small matrices, in numpy", lambda folder: api.identifiability(information())),
    **arms(RECORDING),
    "load_case": ("reads files", lambda folder: toml(folder)()),
    "load_diagnosis": ("reads files", lambda folder: api.load_diagnosis(saved_diagnosis(folder))),
    "load_fit": ("reads a file", lambda folder: api.load_fit(saved_fit(folder))),
    "mujoco_joint": ("a few numbers", lambda folder: api.mujoco_joint(PLANT)),
    "read_mujoco_joint": ("text", lambda _: api.read_mujoco_joint(api.mujoco_joint(PLANT).mjcf(), "joint")),
    "bam_parameters": ("numbers", lambda _: api.bam_parameters(PLANT, actuator="motor", resistance=1e-5)),
    "isaac_lab_actuator": ("a few numbers", lambda folder: api.isaac_lab_actuator(PLANT)),
    "urdf_dynamics": ("a few numbers", lambda folder: api.urdf_dynamics(PLANT)),
    "plot": ("draws", lambda folder: api.plot(fake_diagnosis(n=500))),
    "recording_from_frame": ("reads a table", lambda folder: api.recording_from_frame(columns())),
    "save_diagnosis": ("writes files", lambda folder: saved_diagnosis(folder)),
    "save_fit": ("writes a file", lambda folder: saved_fit(folder)),
    "resonances": (
        "small least squares next to one peak, in numpy",
        lambda folder: api.resonances(np.arange(9.0), 1.0 / (np.arange(9.0) - 4.2 + 0.3j)),
    ),
    "warm": ("compiles on purpose", lambda _: unwarmed()),
    **calibration(RECORDING),
    "load_study": ("reads files", lambda folder: api.load_study(kept_study(folder))),
    "summarise": ("numpy on the results", lambda folder: api.summarise(api.load_study(kept_study(folder)))),
}
"""Verbs that never touch JAX: why, and a call that shows it."""


@pytest.fixture(scope="module", autouse=True)
def _nothing_compiled():
    """What other tests compiled is forgotten: the first call here is a first call."""
    jax.clear_caches()


def test_the_numbers_of_a_layout_become_arrays_without_a_program():
    drive = start(1.0)
    assert programs(lambda: base_layout(drive, 1.0 / 1234.5)) == []  # the first test: nothing is compiled


@functools.cache
def _first(prepare: Callable[[int], Call]) -> list[str]:
    """What the first call of a verb costs; made once, before any of the others."""
    return programs(prepare(0))


@pytest.mark.parametrize(
    ("prepare", "other"),
    [
        pytest.param(
            row.prepare,
            number,
            id=f"{row.verb}-{word}",
            marks=[pytest.mark.slow] if row.slow else [],
        )
        for row in TRACED
        for number, word in enumerate(row.others, start=1)
    ],
)
def test_other_numbers_trace_and_compile_nothing(prepare, other):
    first = _first(prepare)
    assert any(program.startswith("compiled") for program in first), "the count does not count"
    again = programs(prepare(other))
    assert not again, f"once more: {', '.join(dict.fromkeys(again))}"


@pytest.mark.parametrize("verb", UNTRACED)
def test_a_verb_without_jax_compiles_nothing_at_all(verb, tmp_path):
    _, call = UNTRACED[verb]
    # Numbers read from a file may become arrays of JAX, which is one program for all of them.
    assert [one for one in programs(lambda: call(tmp_path)) if "convert_element_type" not in one] == []


def test_every_public_verb_is_counted():
    verbs = {name for name in api.__all__ if inspect.isfunction(getattr(api, name))}
    verbs |= {f"excitation.{name}" for name, value in vars(excitation).items() if inspect.isfunction(value)}
    verbs |= {"simulation.simulate_reference", "simulation.predict_ahead"}
    counted = {row.verb for row in TRACED}
    assert counted | set(UNTRACED) == verbs
    assert not counted & set(UNTRACED)
