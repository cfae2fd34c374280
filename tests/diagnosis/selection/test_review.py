"""Review: each of several effects is needed beside the others; two of one size are found though neither is alone."""

import dataclasses
import json
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop, stick_noise
from helpers_selection import LAG, Bench, converged, pushes, with_effect, world

from frictionjax.core import silent
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection import select as select_module
from frictionjax.diagnosis.selection.acceptance import best_likelier, only_complete
from frictionjax.diagnosis.selection.refitted_tables import fitted_to_all, lower_base, silenced, with_some
from frictionjax.diagnosis.selection.round import Round
from frictionjax.diagnosis.selection.search import Decision, decide
from frictionjax.diagnosis.selection.select import Selection, of_another_base, select
from frictionjax.diagnosis.selection.stored_tables import StoredTables
from frictionjax.diagnosis.table import Lead, table_json, table_of
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.physics import Drive, catalogue

RULE = Rule()
ADEQUATE = RULE.limits.adequate


@pytest.fixture(scope="module")
def two():
    """A plant with a load and a lag of the drive, the base model, and its sizes."""
    return world("load", "lag")


@pytest.fixture(scope="module")
def one():
    """A plant with a lag of the drive alone."""
    return world("lag")


@pytest.mark.parametrize("effects", [(), (LAG,)])
def test_a_parameter_that_stick_leaves_open_is_no_missing_physics(effects):
    """Noise in stick says little of Coulomb friction, and the moves held out then miss; unless more is missing, one
    set of parameters predicts all."""
    drive = PLANT.with_effects(*effects)
    recordings = [
        recording
        for seed in (1, 3)
        for recording in (
            open_loop("stick", stick_noise(1.2, seed=seed), seed=seed, drive=drive),
            open_loop("moves", pushes(seed), seed=seed + 1, drive=drive, role="holdout"),
        )
    ]
    batch = make_batch(tuple(recordings), encoder_step=FINE)
    friction = dataclasses.replace(PLANT.friction, Fc=1.05 * PLANT.friction.Fc, Fs=1.05 * PLANT.friction.Fs)
    wrong = Drive(PLANT.J, friction, PLANT.motor_constant)
    posterior, vector = robust_posterior(wrong, batch, np.array([False, True, False, True]))
    model = converged(posterior.at_bandwidth(SLOW_BANDWIDTH), vector)
    floor = np.ones_like(model.judgement.power)
    assert not model.judgement.within(floor, ADEQUATE)[1]
    assert all(fitted_to_all(model).judgement.within(floor, ADEQUATE)) == (not effects)


@pytest.mark.untyped
def test_a_model_with_some_of_the_effects_is_the_one_fitted_with_them(two):
    base, scales = two
    alone = with_effect(base, "lag", scales)
    full = with_effect(with_effect(base, "load", scales), "lag", scales)
    rest = with_some(base, full, [1], scales)
    assert [type(e).__name__ for e in rest.posterior.drive.effects] == ["DriveLag"]
    # The load that is missing leaves sigma2 and vs in a flat valley: from the better start it ends a little lower.
    assert rest.fitted.misfit == pytest.approx(alone.fitted.misfit, rel=2e-2)
    assert rest.fitted.misfit < alone.fitted.misfit * (1.0 + 1e-3)
    back = with_some(base, full, [0, 1], scales)
    assert back.fitted.misfit == pytest.approx(full.fitted.misfit, rel=1e-3)


@pytest.mark.untyped
def test_what_goes_takes_along_what_made_up_for_it(two):
    """Without the load the other parameters stand where the quadratic cost of the full model is least."""
    base, scales = two
    full = with_effect(with_effect(base, "load", scales), "lag", scales)
    labels = [free.label for free in full.posterior.layout]
    step = silenced(full, [0]) - full.fitted.vector
    gone = labels.index("load")
    assert silenced(full, [0])[gone] == 0.0 and step[gone] != 0.0
    slope = np.asarray(full.fitted.near.hessian) @ step
    assert np.max(np.abs(np.delete(slope, gone))) < 1e-6 * np.max(np.abs(slope))
    assert np.linalg.norm(np.delete(step, gone)) > 0.0


@pytest.mark.untyped
def test_a_base_fit_that_came_to_rest_too_high_makes_way(two):
    """As out of a side valley: any effect leads out of it, and would be named."""
    base, scales = two
    full = with_effect(base, "lag", scales)
    aside = descend(base.posterior, base.fitted.vector + 0.05, graduate=False, steps=0)
    high = Model(base.posterior, aside, judge(base.posterior, aside))
    assert high.fitted.misfit > base.fitted.misfit + 2.0 * ADEQUATE
    lower = lower_base(full, high, RULE)
    assert lower is not None and not lower.posterior.drive.effects
    assert lower.fitted.misfit == pytest.approx(base.fitted.misfit, rel=2e-2)
    assert lower_base(full, base, RULE) is None
    # The tables of both searches are kept, under names that no search asks for.
    tables = tuple(of_another_base((Bench(base, scales).a_round(base, full, "lag").table,)))
    assert tables[0].asked[0] == "another base" and tables[0].key == "first t0"


@pytest.mark.untyped
def test_progress_goes_on_where_a_selection_is_made_again(two, monkeypatch):
    base, shown = two[0], []
    nothing = Selection([], Decision((), "adequate", False, 0.0, ()), ())

    def one_selection(model, executor, progress, *rest):
        for fraction in (0.0, 0.4, 0.8):
            progress("testing every effect", fraction)
        return nothing

    monkeypatch.setattr(select_module, "_selected", one_selection)
    monkeypatch.setattr(select_module, "_from_lower_base", lambda found, model, rule: base)
    monkeypatch.setattr(select_module, "_at_the_pace_of", lambda found, model, rule: None)
    with ThreadPoolExecutor(1) as executor:
        select(base, executor, lambda stage, fraction: shown.append(fraction))
    assert shown == pytest.approx([0.0, 0.4, 0.8, 0.8, 0.88, 0.96])


@pytest.mark.untyped
def test_both_effects_that_are_there_stay(two):
    bench = Bench(*two)
    chain = bench.chain("load", "lag")
    assert max(chain[-1].row.misfits_after) < ADEQUATE
    assert bench.search.superfluous(chain) is None
    assert bench.search.drop(chain) is chain
    assert bench.tables.whole(chain).gains(RULE).share > RULE.accept.enough_share


@pytest.mark.untyped
def test_an_effect_that_is_not_there_goes(one):
    """Accepted before the true one, it is not needed beside it."""
    bench = Bench(*one)
    chain = bench.chain("load", "lag")
    assert bench.search.superfluous(chain) == 0
    fewer = bench.search.drop(chain)
    assert [found.row.effect for found in fewer] == ["drive_lag"]
    assert bench.tables.step(fewer[0]).before is one[0]
    layout = bench.model(fewer[0]).posterior.layout
    assert [free.label for free in layout if free.path.startswith("effects.")] == ["time_constant"]


def _row(row, share_fit, share_held, **more):
    """The same comparison with these shares of the misfit."""
    shares = (share_fit, share_held)
    left = tuple(whole * (1.0 - share) for whole, share in zip(row.misfits_before, shares, strict=True))
    return dataclasses.replace(row, misfits_after=left, **more)


@pytest.mark.untyped
def test_after_nearly_all_only_what_ends_it_is_named(two):
    """A round beyond nearly all: what explains 90 % of the rest stays, what explains two thirds of it goes."""
    (found,) = Bench(*two).chain("load")
    for share, stays in ((0.9, True), (0.65, False)):
        table = dataclasses.replace(found.table, rows=(_row(found.row, 0.95, share),))
        after = only_complete(Round(table, 0), RULE)
        assert (after.accepted is not None) == stays
        assert bool(after.dropped) != stays
    # Or what leaves an adequate model, however little it was that was left.
    row = dataclasses.replace(_row(found.row, 0.95, 0.65), misfits_after=(0.0, 0.5 * RULE.limits.adequate))
    assert only_complete(Round(dataclasses.replace(found.table, rows=(row,)), 0), RULE).accepted == 0
    nothing = Round(found.table, None)
    assert only_complete(nothing, RULE) is nothing


@pytest.mark.untyped
def test_what_is_likelier_is_tried_with_another_although_it_explains_too_little(two):
    (found,) = Bench(*two).chain("load")
    assert best_likelier(found.table, RULE) == 0
    # Not what chance does, nor what explains nothing, nor where there is nothing.
    chance = _row(found.row, 0.5, 0.9, fit=Lead(2e3, 1e3, 9), held_out=Lead(1e3, 1e3, 9))
    for rows in ((), (_row(found.row, 0.0, 0.0),), (chance,)):
        assert best_likelier(dataclasses.replace(found.table, rows=rows), RULE) is None
    # What gains most may be chance; then the next that is clear begins.
    rows = (dataclasses.replace(chance, fit=Lead(9e9, 9e9, 9)), _row(found.row, 0.6, 0.3))
    assert best_likelier(dataclasses.replace(found.table, rows=rows), RULE) == 1


@pytest.mark.untyped
def test_two_effects_of_one_size_are_found(two):
    """Neither may be named alone."""
    base, _ = two
    without = frozenset(catalogue()) - {"constant_load", "drive_lag", "return_spring"}
    with ThreadPoolExecutor(2) as executor:
        found = select(base, executor, silent, without=without)
    assert set(found.decision.names) == {"constant_load", "drive_lag"}
    alone = [step for step in found.steps if step.accepted is not None]
    drive = alone[-1].accepted.model.judgement.drive
    sizes = {type(e).__name__: e for e in drive.effects}
    assert float(sizes["ConstantLoad"].load) == pytest.approx(0.007, rel=0.05)
    assert float(sizes["DriveLag"].time_constant) == pytest.approx(3e-5, rel=0.05)
    assert jnp.all(jnp.isfinite(alone[-1].accepted.model.fitted.vector))
    # What was stored decides the same, without a model.
    stored = [table_of(json.loads(json.dumps(table_json(table)))) for table in found.tables]
    again = decide(StoredTables(stored, RULE, RULE), RULE, 3)
    for part in ("names", "classes", "verdict", "remains", "share", "evidence"):
        assert getattr(again, part) == getattr(found.decision, part)
