"""`save_fit` and `load_fit`: what comes back is what was saved, and a bad file is a sentence with a cure."""

import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop, stick_noise
from helpers_plants import FORMS, effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.core import InputError, PrecisionError
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.fit import finish, make_problem
from frictionjax.exchange.fit_file import fit_from_json, fit_to_json, load_fit, save_fit
from frictionjax.exchange.table import fields_of
from frictionjax.physics import Drive, LuGre

UNITS = {"force": "µN*m", "position": "rad", "input": "V"}


@pytest.fixture(scope="module")
def result():
    """The end of a fit of a drive with two effects, of which the recording says little: one error is infinite."""
    recording = open_loop("quiet", stick_noise(0.6), seed=3)
    drive = PLANT.with_effects(effect("ConstantLoad", load=0.01), effect("Ripple", sine=1e-3, period=1 / 3))
    problem, vector = make_problem(drive, make_batch((recording,), encoder_step=FINE), scales={"Fc": 0.5})
    return finish(problem, vector.at[0].set(problem.setting.start[0] + 2.0), True, UNITS)


@pytest.fixture
def content(result):
    """The file as a table, to be spoiled."""
    return json.loads(fit_to_json(result))


def refused(content):
    """The sentence for a file with this content."""
    with pytest.raises(InputError) as caught:
        fit_from_json(json.dumps(content), file="fit.json")
    assert str(caught.value).startswith("fit.json")
    return str(caught.value)


def test_all_but_the_recordings_comes_back_equal(result, tmp_path):
    assert save_fit(result, tmp_path / "fit.json") == tmp_path / "fit.json"
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    back = load_fit(tmp_path / "fit.json")
    assert math.isinf(result.stderr["J"])
    assert eqx.tree_equal(back.drive, result.drive)
    assert back.parameters == result.parameters
    assert back.stderr == result.stderr
    np.testing.assert_array_equal(back.covariance, result.covariance)
    np.testing.assert_array_equal(back.vector, result.vector)
    assert (back.mismatch, back.success, back.message) == (result.mismatch, result.success, result.message)
    assert back.message.endswith("At the end of its range: J.")
    assert eqx.tree_equal(back.problem.layout, result.problem.layout)
    assert eqx.tree_equal(back.problem.drive(back.vector), result.problem.drive(result.vector))


def test_writing_twice_gives_the_same_text(result):
    text = fit_to_json(result)
    assert fit_to_json(fit_from_json(text)) == text
    assert "µN*m" in text


def test_a_fit_that_overflowed_comes_back(result):
    lost = eqx.tree_at(
        lambda r: (r.covariance, r.mismatch, r.vector),
        result,
        (np.full_like(result.covariance, np.inf), math.inf, result.vector.at[1].set(jnp.nan)),
    )
    text = fit_to_json(lost)
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no strict JSON"))
    back = fit_from_json(text)
    np.testing.assert_array_equal(back.covariance, lost.covariance)
    assert back.mismatch == math.inf
    np.testing.assert_array_equal(back.vector, lost.vector)


numbers = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
forms = st.lists(
    st.sampled_from(sorted(FORMS)).flatmap(
        lambda name: st.builds(FORMS[name], **dict.fromkeys(fields_of(FORMS[name]), numbers))
    ),
    max_size=4,
)
drives = st.builds(
    lambda J, km, values, effects: Drive(J, LuGre(*values), km, tuple(effects)),
    numbers,
    numbers,
    st.tuples(*[numbers] * 6),
    forms,
)


@settings(max_examples=60, deadline=None)
@given(drive=drives)
def test_every_drive_comes_back_to_the_last_bit(result, drive):
    back = fit_from_json(fit_to_json(eqx.tree_at(lambda r: r.drive, result, drive))).drive
    assert eqx.tree_equal(back, drive)
    assert [type(part) for part in back.effects] == [type(part) for part in drive.effects]


FIELDS = [
    *("schema", "success", "message", "mismatch", "drive", "parameters", "covariance", "vector", "problem"),
    *("drive.J", "drive.friction.sigma0", "drive.effects", "drive.effects.1.form"),
    *("drive.effects.1.parameters.period", "parameters.Fc.stderr", "parameters.Fc.identified"),
    *("problem.start", "problem.layout.0.path"),
]


def holder(content, field):
    """The table that holds a field, and its last key."""
    *way, last = field.split(".")
    for part in way:
        content = content[int(part) if part.isdigit() else part]
    return content, last


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_that_is_missing_or_of_another_kind(content, field):
    table, key = holder(content, field)
    del table[key]
    sentence = refused(content)
    assert f"field `{field}`" in sentence
    assert sentence.endswith(".")
    if field != "schema":
        assert sentence.endswith("the field is missing. Write the file again with `save_fit`.")
    table[key] = {"drive": []}.get(key, "much" if key not in ("message", "form", "path") else 7)
    assert f"field `{field}`" in refused(content)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("schema", "frictionjax.verdict/1", 'the schema is "frictionjax.verdict/1", not "frictionjax.fit/1"'),
        ("drive.effects.0.name", "constant_lode", "no effect `constant_lode`. Did you mean `constant_load`?"),
        ("drive.effects.1.form", "Ripples", "`ripple` has no form `Ripples`. Did you mean `Ripple`?"),
        ("drive.effects.1.parameters.cosin", 1.0, "`cosin` is not known here. Did you mean `cosine`?"),
        ("drive.friction.sigma3", 1.0, "`sigma3` is not known here"),
        ("problem.layout.0.path", "K", "the drive has no parameter `K`"),
        ("problem.start", [1.0], "1 numbers are too few for 11 free parameters"),
        ("covariance", [[1.0]], "is not a list of 12 rows"),
        ("covariance", [[1.0]] * 12, "field `covariance.0`: [1.0] is not a list of 12 numbers"),
        ("vector", ["a"], "is not a list of 12 numbers"),
        ("drive.J", True, "true is not a number"),
        ("drive.J", 10**400, "is not a number"),
        ("drive.effects", [3], "field `drive.effects.0`: 3 is not a table"),
    ],
)
def test_a_field_that_is_wrong(content, field, value, words):
    table, key = holder(content, field)
    table[key] = value
    assert words in refused(content)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"schema": NaN}', "[" * 100000, "﻿{}"])
def test_text_that_is_no_table(text):
    with pytest.raises(InputError, match=r"^fit\.json: is (not JSON|JSON, but no table)") as caught:
        fit_from_json(text, file="fit.json")
    assert str(caught.value).endswith("Write the file again with `save_fit`.")


def test_files_that_cannot_be_read_or_written(result, tmp_path):
    save_fit(result, tmp_path / "fit.json")
    with pytest.raises(InputError, match=r'does not exist\. Did you mean "fit\.json"\?'):
        load_fit(tmp_path / "fits.json")
    (tmp_path / "latin.json").write_bytes(b'{"schema": "\xe9"}')
    with pytest.raises(InputError, match="is not text in UTF-8"):
        load_fit(tmp_path / "latin.json")
    before = sorted(path.name for path in tmp_path.iterdir())
    for path in (tmp_path / "none" / "fit.json", tmp_path, "", "a\0b"):
        with pytest.raises(InputError, match=r"cannot be written .* Choose another file or folder\."):
            save_fit(result, path)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_arrays_of_drives_and_float32_are_refused(result):
    many = eqx.tree_at(lambda r: r.drive.J, result, jnp.ones(3))
    with pytest.raises(ValueError, match=r"A drive of shape \(3,\) has no file"):
        fit_to_json(many)
    text = fit_to_json(result)
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="float64"):
        fit_from_json(text)
