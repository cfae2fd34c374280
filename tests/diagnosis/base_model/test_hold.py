"""Which input is likelier, where the case leaves it to the recordings."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_arm import ARM, NOISE

from frictionjax.core import silent
from frictionjax.diagnosis.base_model.input_hold import HOLD, base_with_likelier_hold, likelier, with_hold
from frictionjax.diagnosis.evidence.judgement import Judgement
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.estimation.data.batch import make_batch
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import simulate

PLAIN = dataclasses.replace(ARM, effects=())
RATE, SECONDS, PARTS = 100.0, 10.0, 20


def _recording(number, hold):
    """A recording at 100 Hz of an input that is held, or runs straight from sample to sample; simulated at 2 kHz."""
    rng = np.random.default_rng(number)
    t = np.arange(round(SECONDS * RATE)) / RATE
    slow, fast = 2.0 * np.pi * (0.31 + 0.05 * number), 2.0 * np.pi * 2.3
    v = 0.7 * slow * np.cos(slow * t + number) + 0.12 * fast * np.cos(fast * t + 2.0 * number)
    u = 0.35 * np.gradient(v, t) + 0.08 * v + 0.65 * np.tanh(v / 0.05)
    place = np.arange(t.size * PARTS) / PARTS
    fine = u[place.astype(int)] if hold == "zero" else np.interp(place + 0.5 / PARTS, np.arange(t.size), u)
    x = np.asarray(simulate(PLAIN, fine, RATE * PARTS, substeps=1).x)[::PARTS]
    role = "holdout" if number == 2 else "fit"
    return Recording(f"swing_{number}", RATE, u, x + NOISE * rng.standard_normal(t.size), role=role)


def _judged(batch, power):
    """A model that leaves innovations of this power in the fitted recording, and the reverse in the held-out one."""
    powers = np.array([[power], [1.0 / power]]) * np.ones(np.asarray(batch.block_count).shape)
    return Judgement(PLAIN, np.zeros(9), powers, np.array([False, True]), batch)


@pytest.fixture(scope="module")
def case():
    """Two recordings of which nothing but the shape is used, and an input that they decide."""
    rng = np.random.default_rng(5)
    recordings = [
        Recording(name, RATE, np.ones(1000), rng.standard_normal(1000), role=role)
        for name, role in (("run", "fit"), ("kept", "holdout"))
    ]
    return Case("coarse", Plant(1.0, hold="auto"), recordings)


@pytest.mark.untyped
@pytest.mark.parametrize(("power", "hold"), [(0.98, "linear"), (1.02, "zero"), (1.0, "zero")])
def test_the_likelier_input_is_kept_and_said(case, monkeypatch, power, hold):
    """Near the noise the log-likelihood is half of the sum of squares; held-out recordings choose nothing."""
    batch, fitted = make_batch(case.recordings, encoder_step=1e-9), []
    module = "frictionjax.diagnosis.base_model.input_hold"
    start = SimpleNamespace(drives=(PLAIN,))
    starting = SimpleNamespace(
        start=start, batch=batch, held_out=None, imposed=False, own=SimpleNamespace(fixed=frozenset())
    )
    models = [SimpleNamespace(judgement=_judged(batch, one)) for one in (1.0, power)]
    monkeypatch.setattr(f"{module}.starting_point", lambda case: SimpleNamespace(**vars(starting), case=case))
    monkeypatch.setattr(f"{module}.base_of", lambda given, *more, **named: fitted.append(given) or models[0])
    monkeypatch.setattr(f"{module}.fit_base", lambda *given, like, **named: models[1])
    found, kept, base, (sentence,), (table,) = base_with_likelier_hold(case, starting, None, silent)
    assert found.plant.hold == hold and base is models[0]
    assert (kept is starting) == (hold == "zero") and len(fitted) == (1 if hold == "zero" else 2)
    samples = float(np.asarray(batch.block_count)[0].sum())
    (row,) = table.rows
    assert table.asked == (HOLD,) and likelier(row) == hold
    nats = 2.0 * np.array([abs(row.fit.total), row.fit.error])
    assert nats[0] == pytest.approx(0.5 * samples * abs(1.0 - power), rel=0.02)
    assert f"is {nats[0]:.3g} ± {nats[1]:.2g} higher than with an input that is" in sentence


@pytest.mark.slow
@pytest.mark.parametrize("hold", ["linear", "zero"])
def test_the_input_that_was_is_found_with_the_plant(hold):
    """Coarse logs: half a sample is 5 ms."""
    plant = Plant(1.0, "rad", "N*m", "N*m", hold="auto")
    case = Case("coarse", plant, [_recording(number, hold) for number in range(3)])
    with ThreadPoolExecutor(2) as executor:
        found, starting, base, said, _ = base_with_likelier_hold(case, starting_point(case), executor, silent)
    assert found.plant.hold == hold
    drive = base.judgement.drive
    assert drive.hold == hold and starting.start.drives[0].hold == hold
    for name, value in (("J", drive.J), ("Fc", drive.friction.Fc), ("sigma2", drive.friction.sigma2)):
        true = PLAIN.J if name == "J" else getattr(PLAIN.friction, name)
        assert float(value) == pytest.approx(float(true), rel=0.05), name
    words = {"zero": "held between samples", "linear": "linear between samples"}
    (sentence,) = said
    assert sentence.startswith(f'The input is taken to be {words[hold]} (hold = "auto"): the log-likelihood')


@pytest.mark.untyped
def test_a_known_input_is_taken_as_it_is(monkeypatch):
    """One fit, and nothing to say."""
    fitted = []
    monkeypatch.setattr(
        "frictionjax.diagnosis.base_model.input_hold.base_of", lambda *given, **named: fitted.append(given[0])
    )
    case = Case("coarse", Plant(1.0, hold="auto"), [_recording(number, "linear") for number in range(3)])
    for hold in ("zero", "linear"):
        known = with_hold(case, hold)
        assert [drive.hold for drive in starting_point(known).start.drives[:1]] == [hold]
        assert base_with_likelier_hold(known, starting_point(known), None, silent)[3:] == ((), ())
    assert len(fitted) == 2
