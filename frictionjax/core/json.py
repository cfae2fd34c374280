"""Results as strict JSON: plain types only, and null for what is not finite."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np


def plain_json(value: Any) -> Any:
    """`value` in the types of strict JSON all the way down, for `json.dumps(..., allow_nan=False)`.

    **Arguments:**

    - `value`: a Module (an `Estimate`, say) becomes a dictionary of its fields, a mapping one with text keys; tuples,
        and arrays of numpy or JAX, become lists; numbers that are not finite become None.

    **Returns:**

    Dictionaries, lists, texts, numbers, booleans and None; what is of none of these kinds is returned as it is, and
    `json.dumps` refuses it.
    """
    if isinstance(value, eqx.Module):
        return {field.name: plain_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a scalar of numpy or JAX
        return plain_json(np.asarray(value).tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
