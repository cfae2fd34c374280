"""`save_fit` and `load_fit`: what comes back is what was saved, and a bad file is a sentence with a cure.

A file of a real fit is read back in tests/information/test_identifiability.py, where there is one.
"""

import dataclasses
import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import PLANT
from helpers_plants import FORMS, effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.core import Estimate, InputError, PrecisionError
from frictionjax.estimation import FitResult, RecordingNoise
from frictionjax.exchange.fit_file import fit_from_json, fit_to_json, load_fit, save_fit
from frictionjax.exchange.table import fields_of
from frictionjax.physics import Drive, LuGre

NAMES = ("J", "Fc", "load")


@pytest.fixture
def result():
    """What a fit might have found: one parameter at its end, one tied to another, a response without a position."""
    return FitResult(
        drive=PLANT.with_effects(
            effect("ConstantLoad", load=0.01), effect("Ripple", sine=1e-3, period=1 / 3)
        ),
        parameters={
            "J": Estimate(0.03, math.inf, "µN*m*s^2/rad", False),
            "Fc": Estimate(0.5, 1 / 300, "µN*m"),
            "load": Estimate(0.01, 1e-4, "µN*m"),
            "Fs": Estimate(0.62, 1 / 242, "µN*m"),
        },
        names=NAMES,
        covariance=np.array([[0.0, 0.0, 0.0], [0.0, 1 / 9e4, 1e-9], [0.0, 1e-9, 1e-8]]),
        covariance_white=np.diag([0.0, 1e-7, 1e-8]),
        noise={
            "ramp": RecordingNoise(1e-6, 0.0, 1.01),
            "response 1": RecordingNoise(math.nan, 0.0, 0.97),
        },
        cost=-12345.6789,
        success=True,
        message="The fit converged: neither noise nor parameters move any more. At the end of its range: J.",
        at_bounds=("J",),
    )


def test_what_the_input_does_between_samples_comes_back(result):
    """Files without a word of it are of held inputs, as those of earlier versions."""
    assert '"hold"' not in fit_to_json(result)
    linear = dataclasses.replace(result, drive=dataclasses.replace(result.drive, hold="linear"))
    text = fit_to_json(linear)
    assert_same(fit_from_json(text), linear)
    with pytest.raises(
        InputError, match=r'field `drive.hold`: "first" is no hold of the input. Write zero or linear'
    ):
        fit_from_json(text.replace('"hold": "linear"', '"hold": "first"'))


def assert_same(back, result):
    """All that is saved is the same to the last bit."""
    assert eqx.tree_equal(back.drive, result.drive)
    assert [type(part) for part in back.drive.effects] == [type(part) for part in result.drive.effects]
    assert (back.posterior, back.vector) == (None, None)
    for key in ("names", "cost", "success", "message", "at_bounds", "stderr", "parameters"):
        assert getattr(back, key) == getattr(result, key), key
        assert type(getattr(back, key)) is type(getattr(result, key)), key
    for key in ("covariance", "covariance_white"):
        np.testing.assert_array_equal(getattr(back, key), getattr(result, key), strict=True)
    assert list(back.noise) == list(result.noise)
    for name, noise in result.noise.items():  # two that are not a number are not equal, but read alike
        assert repr(back.noise[name]) == repr(noise)


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


def test_all_but_the_data_comes_back_equal(result, tmp_path):
    assert save_fit(result, tmp_path / "fit.json") == tmp_path / "fit.json"
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    back = load_fit(tmp_path / "fit.json")
    assert math.isinf(back.stderr["J"])
    assert_same(back, result)


def test_writing_twice_gives_the_same_text(result):
    text = fit_to_json(result)
    assert fit_to_json(fit_from_json(text)) == text
    assert "µN*m" in text


def test_a_fit_that_overflowed_comes_back(result):
    lost = dataclasses.replace(
        result,
        covariance=np.full((3, 3), np.inf),
        covariance_white=np.full((3, 3), np.inf),
        cost=math.inf,
        success=False,
    )
    text = fit_to_json(lost)
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no strict JSON"))
    assert_same(fit_from_json(text), lost)


numbers = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
errors = numbers | st.just(math.inf)
fields = {name: fields_of(form) for name, form in FORMS.items()}
forms = st.lists(
    st.sampled_from(sorted(FORMS)).flatmap(
        lambda name: st.builds(FORMS[name], **dict.fromkeys(fields[name], numbers))
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
words = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)


@st.composite
def results(draw):
    """Any result, whether a fit could find it or not."""
    parameters = draw(
        st.dictionaries(words, st.builds(Estimate, numbers, errors, words, st.booleans()), max_size=4)
    )
    labels = st.lists(st.sampled_from(sorted(parameters)), unique=True) if parameters else st.just([])
    names = draw(labels.map(tuple))
    p = len(names)
    rows = st.lists(errors, min_size=p * p, max_size=p * p)
    matrix = rows.map(lambda row: np.array(row, dtype=float).reshape(p, p))
    known = numbers | st.just(math.nan)
    return FitResult(
        drive=draw(drives),
        parameters=parameters,
        names=names,
        covariance=draw(matrix),
        covariance_white=draw(matrix),
        noise=draw(st.dictionaries(words, st.builds(RecordingNoise, known, known, known), max_size=3)),
        cost=draw(errors),
        success=draw(st.booleans()),
        message=draw(words),
        at_bounds=draw(labels.map(tuple)),
    )


@settings(max_examples=100)
@given(result=results())
def test_every_result_comes_back_to_the_last_bit(result):
    assert_same(fit_from_json(fit_to_json(result)), result)


FIELDS = [
    *("schema", "success", "message", "cost", "at_bounds", "drive", "parameters", "names", "noise"),
    *("covariance", "covariance_white", "drive.J", "drive.friction.sigma0", "drive.effects"),
    *("drive.effects.1.form", "drive.effects.1.parameters.period", "parameters.Fc.stderr"),
    *("parameters.Fc.identified", "parameters.Fc.unit", "noise.ramp.push"),
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
    table[key] = {"drive": []}.get(key, "much" if key not in ("message", "form", "unit") else 7)
    assert f"field `{field}`" in refused(content)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("schema", "frictionjax.verdict/1", 'the schema is "frictionjax.verdict/1", not "frictionjax.fit/1"'),
        ("drive.effects.0.name", "constant_lode", "no effect `constant_lode`. Did you mean `constant_load`?"),
        ("drive.effects.1.form", "Ripples", "`ripple` has no form `Ripples`. Did you mean `Ripple`?"),
        ("drive.effects.1.parameters.cosin", 1.0, "`cosin` is not known here. Did you mean `cosine`?"),
        ("drive.friction.sigma3", 1.0, "`sigma3` is not known here"),
        ("drive.mass", 1.0, "field `drive.mass`: `mass` is not known here. Known here: J, motor_constant"),
        ("drive.effects.0.names", "a", "`names` is not known here. Did you mean `name`?"),
        ("parameters.Fc.stder", 1.0, "field `parameters.Fc.stder`: `stder` is not known here. Did you mean"),
        ("noise.ramp.pull", 1.0, "field `noise.ramp.pull`: `pull` is not known here"),
        ("mismatch", 1.0, "field `mismatch`: `mismatch` is not known here"),
        ("names", ["J", "Fc", "load", "vs"], "field `names`: `vs` is not one of `parameters`"),
        ("names", ["J", "Fc", "J"], "is not a list of different texts"),
        ("names", ["J", "Fc", 3], "is not a list of texts"),
        ("at_bounds", ["Fd"], "field `at_bounds`: `Fd` is not one of `parameters`"),
        ("covariance", [[1.0]], "is not a list of 3 rows"),
        ("covariance", [[1.0]] * 3, "field `covariance.0`: [1.0] is not a list of 3 numbers"),
        ("covariance_white", [[1.0, 2.0, "a"]] * 3, "is not a list of 3 numbers"),
        ("covariance_white", [3] * 3, "field `covariance_white.0`: 3 is not a list of 3 numbers"),
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
    with pytest.raises(InputError, match=r"^fit\.json: is (not JSON|JSON, but not a table)") as caught:
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
