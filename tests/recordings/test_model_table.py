"""The user's own model in a case file: what is read, and what is refused with its place."""

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings import Given, GivenEffect, GivenModel, load_case
from frictionjax.recordings.model_table import parse_model

CASE = """
[model]
parameters = {J = 0.22, Fc = {value = 0.2, fixed = true}}
effects = [
  {name = "gravity_pendulum", sine = 4.3, cosine = {value = 0.1}},
  {name = "ripple", form = "Ripple", period = 1},
]
[[recording]]
file = "run.csv"
"""


def _write(folder, text):
    rows = np.column_stack([np.arange(400) / 100.0, np.sin(np.arange(400)), 0.1 * np.cos(np.arange(400))])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header="t,u,x", comments="")
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"


def test_a_model_stands_in_the_case(tmp_path):
    file = _write(tmp_path, CASE)
    with pytest.warns(match="last third"):
        case = load_case(file)
    gravity = GivenEffect("gravity_pendulum", values={"sine": Given(4.3), "cosine": Given(0.1)})
    ripple = GivenEffect("ripple", "Ripple", {"period": Given(1.0)})
    model = GivenModel({"J": Given(0.22), "Fc": Given(0.2, True)}, (gravity, ripple), str(file))
    assert case.model == model
    assert len(case.recordings) == 2  # and it is still there after a third was held out


def test_effects_may_stand_in_tables_of_their_own(tmp_path):
    text = '[[model.effects]]\nname = "delay"\n[[recording]]\nfile = "run.csv"\n'
    with pytest.warns(match="last third"):
        case = load_case(_write(tmp_path, text))
    assert case.model is not None and case.model.effects == (GivenEffect("delay"),)


def test_without_a_model_there_is_none(tmp_path):
    with pytest.warns(match="last third"):
        assert load_case(_write(tmp_path, '[[recording]]\nfile = "run.csv"\n')).model is None
    assert parse_model(None, "case.toml") is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("gravity", "key `model`: the model is not a table"),
        ({"parameter": {}}, "key `parameter`: unknown key `parameter`. Did you mean `parameters`?"),
        ({"parameters": ["J"]}, "key `parameters`: the parameters are not a table"),
        ({"parameters": {"J": "0.2"}}, "key `parameters.J`: a number is needed, not text"),
        ({"parameters": {"J": True}}, "key `parameters.J`: a number is needed, not true or false"),
        ({"parameters": {"J": float("inf")}}, "key `parameters.J`: inf is not a finite number"),
        ({"parameters": {"J": {"fixed": True}}}, "key `parameters.J`: there is no value"),
        (
            {"parameters": {"J": {"value": 1.0, "fixed": "yes"}}},
            "key `parameters.J.fixed`: fixed is true or false",
        ),
        (
            {"parameters": {"J": {"value": 1.0, "fix": True}}},
            "key `parameters.J.fix`: unknown key `fix`. Did you mean",
        ),
        ({"effects": "delay"}, "key `effects`: effects are a list of tables"),
        ({"effects": ["delay"]}, "key `effects`: effects are a list of tables"),
        ({"effects": [{"name": "delay"}, {"sine": 1.0}]}, "key `effects[2].name`: the effect has no name"),
        ({"effects": [{"name": 3}]}, "key `effects[1].name`: text is needed"),
        ({"effects": [{"name": "delay", "form": ""}]}, "key `effects[1].form`: the text is empty"),
        (
            {"effects": [{"name": "delay", "delay": [1.0]}]},
            "key `effects[1].delay`: a number is needed, not a list",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place(table, words):
    with pytest.raises(InputError) as found:
        parse_model(table, "case.toml")
    said = str(found.value)
    assert said.replace("[model], ", "").startswith(f"case.toml, {words}")
    assert "\n" not in said
