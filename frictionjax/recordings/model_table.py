"""The user's own model of a machine, as a case file gives it: what is known to act, and values of its parameters.

Names are checked where the catalogue of effects is known, when the model is used.
"""

from typing import Any

from frictionjax.recordings.recording import Given, GivenEffect, GivenModel
from frictionjax.recordings.schema import Spot, known_keys, number, text
from frictionjax.recordings.words import shown

_KEYS = ("parameters", "effects")
_VALUE_KEYS = ("value", "fixed")


def parse_model(table: Any, source: str | None) -> GivenModel | None:
    """The user's own model.

    **Arguments:**

    - `table`: what stands under `[model]`; None where nothing does.
    - `source`: the case file as text, for messages.

    **Returns:** the `GivenModel`; None where there is none.

    **Raises:** `InputError` for an unknown key, a wrong type, or a number out of range.
    """
    if table is None:
        return None
    spot = Spot(source, "[model]" if source else "")
    if not isinstance(table, dict):
        Spot(source).fail(
            "the model is not a table", "model", "Write [model] on a line, and its keys below it"
        )
    known_keys(table, _KEYS, spot)
    parameters = table.get("parameters", {})
    if not isinstance(parameters, dict):
        spot.fail(
            "the parameters are not a table", "parameters", "Write parameters = {J = 0.22, Fc = 0.4}, by name"
        )
    effects = table.get("effects", [])
    if not isinstance(effects, list | tuple) or not all(isinstance(one, dict) for one in effects):
        spot.fail(
            "effects are a list of tables",
            "effects",
            'Write effects = [{name = "gravity_pendulum", sine = 4.3}]',
        )
    values = {name: _given(parameters, name, spot, "parameters.") for name in parameters}
    return GivenModel(
        values, tuple(_effect(one, spot, place) for place, one in enumerate(effects, 1)), source
    )


def _effect(table: dict[str, Any], spot: Spot, place: int) -> GivenEffect:
    prefix = f"effects[{place}]."
    if "name" not in table:
        spot.fail("the effect has no name", f"{prefix}name", 'Add name = "gravity_pendulum"')
    form = text(table, "form", spot, prefix) if "form" in table else ""
    values = {key: _given(table, key, spot, prefix) for key in table if key not in ("name", "form")}
    return GivenEffect(text(table, "name", spot, prefix), form, values)


def _given(table: dict[str, Any], key: str, spot: Spot, prefix: str) -> Given:
    """The value under a key: a number, or a table of it and whether it is fixed."""
    own = table[key]
    if not isinstance(own, dict):
        return Given(_number(table, key, spot, prefix))
    known_keys(own, _VALUE_KEYS, spot, f"{prefix}{key}.")
    if "value" not in own:
        spot.fail("there is no value", prefix + key, f"Write {shown(key)} = {{value = 1.0, fixed = true}}")
    fixed = own.get("fixed", False)
    if not isinstance(fixed, bool):
        spot.fail(
            f"fixed is true or false, not {shown(fixed, 20)}", f"{prefix}{key}.fixed", "Write fixed = true"
        )
    return Given(_number(own, "value", spot, f"{prefix}{key}."), fixed)


def _number(table: dict[str, Any], key: str, spot: Spot, prefix: str) -> float:
    found = number(table, key, spot, prefix)
    assert found is not None  # the key is there
    return found
