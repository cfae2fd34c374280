"""Stored tables: they decide as when they were made, and say where a rule leads off their path."""

import dataclasses
import gzip
import json
from pathlib import Path

import helpers_rule
import numpy as np
import pytest
from helpers_rule import row, table

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.conclusion import CEILING, SHAPE, table_of_map, tables_of
from frictionjax.diagnosis.selection.search import decide
from frictionjax.diagnosis.selection.stored_tables import NotStored, StoredTables, decide_again
from frictionjax.diagnosis.table import Lead, table_json, table_of, table_of_one

RULE = Rule()
_LAST = ((0, 0, (0.6, 0.6)), (0, 1, (0.6, 0.6)), (1, 1, (0.99, 0.99)))
"""Of the last model of a chain of two its place, the table above whose floor it stands, and its shares."""


def _round_trip(one):
    return table_of(json.loads(json.dumps(table_json(one), allow_nan=False)))


def _search(first, *tables, rule=RULE):
    return decide(StoredTables([first, *tables], RULE, rule), rule, 3)


def test_a_table_comes_back_as_it_was():
    gains = (0.1234567891, -2.0)
    own = row(waves=((1.3, True),), gains_fit=gains, gains_held_out=(1e-9,), p_value=1.23456789e-5)
    one = table(own, row((0.2, 0.3), ahead=Lead(-2.0, 1.0, 30)), misfits=(0.123456789012345, 0.2))
    back = _round_trip(one)
    assert back.rows[0].gains_fit == (0.123457, -2.0)
    exact = dataclasses.replace(back.rows[0], gains_fit=gains)
    assert dataclasses.replace(back, rows=(exact, back.rows[1])) == one
    assert back.lead(0, 1, RULE) == 9.0 and back.lead(1, 0, RULE) == -9.0


def test_an_effect_that_explains_all_is_named_from_its_table_alone():
    first = _round_trip(
        table(row((0.99, 0.99), effect="delay", exact=(True,)), row((0.3, 0.3), effect="creep"))
    )
    found = _search(first)
    assert (found.verdict, found.names, found.classes) == ("named", ("delay",), (("delay",),))
    assert found.evidence[0].lead == pytest.approx(1.98 - 0.6)
    twins = table(row((0.99, 0.99), effect="delay"), row((0.98, 0.98), effect="drive_lag"), lead=1.0)
    assert _search(twins).classes == (("delay", "drive_lag"),)


def test_the_likelier_one_is_named_whatever_it_explains():
    """Unless it gains less than one nat for each parameter that it has more."""
    lag, delay = (
        {"effect": name, "fit": Lead(gain, 10.0, 100)} for name, gain in (("lag", 90.0), ("delay", 95.0))
    )
    for shares, free, named in (
        ((0.98, 0.98), 0, "delay"),
        ((0.5, 0.5), 0, "delay"),
        ((0.98, 0.98), 6, "lag"),
    ):
        both = table(row((0.99, 0.99), **lag), row(shares, free=free, **delay), lead=-1.0)
        whole = table(row((0.99, 0.99)), key="t1", asked=("whole", f"t0.{int(named == 'delay')}", "t0"))
        found = _search(both, whole)
        assert found.names == (named,) and set(found.classes[0]) == {"lag", "delay"}


@pytest.mark.parametrize(
    ("whole", "named"),
    [
        ({"shares": (0.35, 0.35)}, ("delay",)),
        ({"shares": (0.25, 0.9)}, ()),
        ({"shares": (0.25, 0.25), "energies": (0.9, 0.85)}, ("delay",)),
        ({"shares": (0.25, 0.25), "energies": (0.9, 0.75)}, ()),
        ({"shares": (0.25, 0.25), "makes_credible": True}, ("delay",)),
    ],
)
def test_what_is_likelier_but_explains_too_little_in_the_end_is_not_named(whole, named):
    """It may have led to a second effect with which all is explained; here there is none."""
    first = table(row((0.4, 0.4), effect="delay"))
    second = table(key="t1", asked=("candidates", "1", "t0.0"), misfits=(0.24, 0.24))
    end = table(row(**whole), key="t2", asked=("whole", "t0.0", "t0"))
    last = table(row(**whole), key="t3", asked=("whole", "t0.0", "t1"))
    found = _search(first, second, end, last)
    assert found.verdict == "unknown" and found.names == named
    if not named:
        assert found.rounds[0].dropped.startswith("clearly likelier")


def test_where_no_effect_stays_in_the_end_nothing_is_named():
    """The first is not needed beside the second, which alone is not accepted."""
    first = table(row((0.6, 0.6), effect="constant_load"))
    second = table(row((0.9, 0.9), effect="delay"), key="t1", asked=("candidates", "1", "t0.0"))
    chain = ("t0.0", "t1.0")
    useless = table(row((0.1, 0.1)), key="t2", asked=("without", "0", *chain))
    alone = table(row((0.1, 0.1), effect="delay"), key="t3", asked=("fewer", "0", "0", *chain))
    whole = table(row((0.6, 0.6)), key="t4", asked=("whole", "t0.0", "t0"))
    found = _search(first, second, useless, alone, whole)
    assert (found.verdict, found.names) == ("unknown", ())


def test_nothing_is_named_where_the_base_model_is_adequate():
    assert _search(table(misfits=(0.004, 0.005))).verdict == "adequate"
    assert _search(table(misfits=(0.4, 0.3))).verdict == "unknown"


def test_a_parameter_that_was_left_open_is_asked_of_all_recordings():
    first = table(row((0.1, 0.1)), misfits=(0.004, 0.3))
    with pytest.raises(NotStored, match="all recordings t0"):
        _search(first)
    together = table(row(before=(0.004, 0.3), shares=(0.0, 0.99)), key="t1", asked=("all recordings", "t0"))
    found = _search(first, together)
    assert found.verdict == "adequate" and found.rounds[0].together
    assert found.rounds[0].dropped.startswith("not needed")


def test_what_is_likelier_than_the_base_model_of_all_recordings_is_no_open_parameter():
    """Half a standard error on either side of what tells two names apart."""
    rng, clusters = np.random.default_rng(0), 40
    scatter = rng.standard_normal(clusters)
    scatter = (scatter - scatter.mean()) / scatter.std()
    for errors, named in ((RULE.rivals.lead + 0.5, ("delay",)), (RULE.rivals.lead - 0.5, ())):
        gains = tuple(scatter + errors / np.sqrt(clusters))
        found = row((0.99, 0.99), before=(0.004, 0.3), effect="delay", exact=(True,))
        ahead = dataclasses.replace(found, gains_fit=gains[:20], gains_held_out=gains[20:])
        together = row(before=(0.004, 0.3), shares=(0.0, 0.99))
        together = dataclasses.replace(together, gains_fit=(0.0,) * 20, gains_held_out=(0.0,) * 20)
        tables = [
            table(ahead, misfits=(0.004, 0.3)),
            table(together, key="t1", asked=("all recordings", "t0")),
            table(found, key="t2", asked=("whole", "t0.0", "t0")),
        ]
        decided = _search(*tables)
        assert decided.names == named
        assert decided.rounds[0].together == (not named)


def test_a_second_effect_is_looked_up_beside_the_first():
    """It is accepted, needed, and stays beside what the first is confused with."""
    first = table(row((0.6, 0.6), effect="constant_load", form="ConstantLoad", exact=(True,)))
    lag = row((0.99, 0.99), effect="drive_lag", form="DriveLag", exact=(True, True), before=(0.16, 0.16))
    second = table(
        lag, key="t1", asked=("candidates", "1", "t0.0"), before=("ConstantLoad",), misfits=(0.16, 0.16)
    )
    chain = ("t0.0", "t1.0")
    needed = table(row((0.98, 0.98)), key="t2", asked=("without", "0", *chain))
    incumbent = row((0.98, 0.98), effect="constant_load", form="ConstantLoad")
    swap = table(incumbent, key="t3", asked=("swap", "0", *chain))
    whole = row((0.996, 0.996), exact=(True, True))
    ends = [
        table(row((0.6, 0.6), exact=(True,)), key="t4", asked=("whole", "t0.0", "t0")),
        table(whole, key="t5", asked=("whole", "t1.0", "t1")),
    ]
    found = _search(*map(_round_trip, (first, second, needed, swap, *ends)))
    assert (found.verdict, found.names) == ("named", ("constant_load", "drive_lag"))
    # Where it is not needed beside the second, the stored search would have had to go on.
    useless = table(row((0.1, 0.1)), key="t2", asked=("without", "0", *chain))
    with pytest.raises(NotStored, match=r"fewer 0 0 t0\.0 t1\.0"):
        _search(first, second, useless, swap, *ends)
    # By another rule the first alone is enough, or nothing is.
    assert _search(first, second, *ends, rule=RULE.changed({"limits.adequate": 0.2})).names == (
        "constant_load",
    )
    strict = RULE.changed({"accept.lead": 1e9})
    assert _search(first, second, *ends, rule=strict).verdict == "unknown"


def test_numbers_that_entered_the_tables_cannot_be_changed_afterwards():
    first = table(row(), excused=True)
    with pytest.raises(NotStored, match="floor"):
        _search(first, rule=RULE.changed({"floor.colour": 3.0}))
    with pytest.raises(NotStored, match="adequate"):
        _search(first, rule=RULE.changed({"limits.adequate": 0.02}))


@pytest.fixture(scope="module")
def two_effects():
    """What was decided of a plant with a load and a lag of its drive, and the tables that decided it."""
    packed = (Path(helpers_rule.__file__).parent / "two_effects.json.gz").read_bytes()
    return json.loads(gzip.decompress(packed))


def _again(two_effects, rule):
    return _search(*map(table_of, two_effects["tables"]), rule=rule)


def test_stored_tables_decide_as_the_refits_did(two_effects):
    """Two effects neither of which explains enough alone: to the last bit."""
    found = _again(two_effects, RULE)
    assert list(found.names) == two_effects["names"] == ["constant_load", "drive_lag"]
    assert (found.verdict, found.share) == (two_effects["verdict"], two_effects["share"])
    assert [list(evidence) for evidence in found.evidence] == two_effects["evidence"]


def test_another_rule_goes_other_ways_on_the_same_tables(two_effects):
    eager = _again(two_effects, RULE.changed({"accept.least_share": 0.4}))
    assert list(eager.names) == two_effects["names"]
    assert _again(two_effects, RULE.changed({"accept.lead": 1e9})).names == ()


def _whole(reference, last, ahead, shares=(1.0, 1.0)):
    """The last model of a chain against the base model, with a lead 0.1 s `ahead`."""
    own = row(shares, effect="", ahead=Lead(ahead, 1.0, 30))
    return table_of_one(f"{reference} {last}", ("whole", reference, last), own, chaotic=False, imposed=False)


def test_what_is_likelier_one_sample_ahead_alone_is_not_named():
    """What makes the innovations of an observer smaller, and predicts worse farther ahead, is not what is missing."""
    rows = (row((0.95, 0.95), effect="flexible"), row((0.9, 0.9), effect="delay", leads=(8.0, 8.0)))
    first = table(*rows, misfits=(0.02, 0.02))
    worse, better = _whole("t0.0", "t0", -3.0), _whole("t0.1", "t0", 2.0)
    found = _search(first, _round_trip(worse), _round_trip(better))
    assert found.names == ("delay",) and found.rounds[0].accepted == 1
    low, chance = (0.02, 0.02), {"misfit_errors": (0.01, 0.01)}
    quiet = table(row((0.95, 0.95), before=low, effect="flexible"), misfits=low, **chance)
    alone = _search(quiet, worse)
    assert (alone.verdict, alone.names) == ("adequate", ())
    assert "0.1 s ahead" in alone.rounds[0].dropped
    same = _whole("t0.0", "t0", 0.0)  # nothing can be said: both runs overflow
    assert _search(quiet, same).names == ("flexible",)


@pytest.mark.parametrize(("ahead", "names"), [(4.0, ("delay", "creep")), (-4.0, ("delay",))])
def test_a_second_name_predicts_farther_ahead_than_the_first_alone(ahead, names):
    first = table(row((0.6, 0.6), effect="delay"))
    more = table(row((0.9, 0.9), effect="creep"), key="t1", asked=("candidates", "1", "t0.0"))
    tables = [
        _whole("t0.0", "t0", 9.0, (0.6, 0.6)),
        _whole("t0.0", "t1", 9.0, (0.6, 0.6)),
        _whole("t1.0", "t1", ahead),
        table_of_one("w", ("without", "0", "t0.0", "t1.0"), row((0.9, 0.9)), chaotic=False, imposed=False),
        table(row((0.9, 0.9), effect="delay"), key="s", asked=("swap", "0", "t0.0", "t1.0")),
    ]
    assert _search(first, more, *tables).names == names


def test_a_lead_without_clusters_is_none():
    assert Lead(0.0, 0.0, 0).in_errors(RULE) == 0.0


@pytest.mark.parametrize(("lead", "verdict"), [(9.0, "unknown"), (1.0, "adequate")])
def test_what_was_tried_after_the_search_decides_again(lead, verdict):
    """A free force that predicts better, as long as it was tried beside the model that this rule accepts."""
    quiet = table(row((0.1, 0.1), before=(0.001, 0.001), leads=(0.0, 0.0)), misfits=(0.001, 0.001))
    free = row((0.5, 0.5), before=(0.1, 0.1), leads=(lead, lead))
    chain = decide(StoredTables([quiet], RULE, RULE), RULE, 3).rounds
    (tried,) = tables_of({CEILING: free, SHAPE: None}, chain)
    stored = [quiet, _round_trip(tried)]
    found = decide_again(StoredTables(stored, RULE, RULE), RULE, 3)
    assert found.verdict == verdict and found.remains == (verdict == "unknown")
    elsewhere = dataclasses.replace(tried, asked=(CEILING, "t0.0"))
    assert decide_again(StoredTables([quiet, elsewhere], RULE, RULE), RULE, 3).verdict == "adequate"


def test_a_force_of_the_position_keeps_its_name_when_decided_again():
    spring = table(row((0.6, 0.6), effect="return_spring", exact=(False,)), row((0.1, 0.1), leads=(0.0, 0.0)))
    nothing = table(row((0.0, 0.0), leads=(0.0, 0.0)), key="t1", asked=("candidates", "1", "t0.0"))
    whole = table_of_one("t2", ("whole", "t0.0", "t1"), spring.rows[0], chaotic=False, imposed=False)
    tables = [spring, nothing, whole]
    chain = decide(StoredTables(tables, RULE, RULE), RULE, 3).rounds
    (mapped,) = tables_of({SHAPE: row((0.95, 0.95))}, chain)
    assert decide_again(StoredTables(tables, RULE, RULE), RULE, 3).verdict == "unknown"
    found = decide_again(StoredTables([*tables, mapped], RULE, RULE), RULE, 3)
    assert found.verdict == "named" and found.share == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("first", "ahead", "more", "names"),
    [
        ("gravity_pendulum", 5.0, 0, ("gravity_pendulum",)),
        ("gravity_pendulum", 0.3, 0, ("gravity_pendulum", "dead_zone")),
        ("gravity_pendulum", 1.5, 0, ("gravity_pendulum",)),
        ("gravity_pendulum", 1.5, 40, ("gravity_pendulum", "dead_zone")),
        ("drive_lag", 5.0, 0, ("drive_lag", "dead_zone")),
    ],
)
def test_a_name_beside_a_force_of_the_position_makes_way_for_a_likelier_map(first, ahead, more, names):
    """The map is likelier by so much in each of 40 clusters, give or take two, and has so many parameters more."""
    scatter = np.tile([2.0, -2.0], 20)
    one = table(row((0.6, 0.6), effect=first))
    two = table(row((0.9, 0.9), effect="dead_zone"), key="t1", asked=("candidates", "1", "t0.0"))
    without = row((0.9, 0.9))
    tables = [
        *(_whole(f"t{last}.0", f"t{own}", 9.0, shares) for last, own, shares in _LAST),
        table_of_one("w", ("without", "0", "t0.0", "t1.0"), without, chaotic=False, imposed=False),
        table(row((0.9, 0.9), effect=first), key="s", asked=("swap", "0", "t0.0", "t1.0")),
    ]
    stored = StoredTables([one, two, *tables], RULE, RULE)
    chain = decide(stored, RULE, 3).rounds
    assert [own.row.effect for own in chain if own.accepted is not None] == [first, "dead_zone"]
    named = row((0.99, 0.99), gains_fit=(10.0,) * 40, gains_held_out=(10.0,) * 9)
    mapped = row((0.99, 0.99), gains_fit=tuple(10.0 + ahead + scatter), gains_held_out=(10.0,) * 9, free=more)
    instead = _round_trip(table_of_map(chain[:2], mapped, named, row((0.6, 0.6))))
    found = decide_again(StoredTables([one, two, *tables, instead], RULE, RULE), RULE, 3)
    assert found.names == names
    if len(names) == 1:
        assert found.verdict == "unknown" and found.share == pytest.approx(0.4)
        assert found.rounds[-1].dropped == (
            "less likely than another shape of gravity_pendulum: a map of its force over the position explains more"
        )
        assert len(found.evidence) == 1
