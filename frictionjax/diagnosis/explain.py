"""Why an effect was named or not: the sentences behind `Diagnosis.explain`."""

from typing import Any

import numpy as np

from frictionjax.core import InputError


def explain_effect(diagnosis: Any, effect: str) -> str:
    """Why the `diagnosis` named an `effect` or did not, in a few sentences.

    **Raises:** `InputError` for a name that is not among its candidates.
    """
    row = next((c for c in diagnosis.candidates if c.effect == effect), None)
    if row is None:
        known = ", ".join(sorted(c.effect for c in diagnosis.candidates))
        raise InputError(f"{effect!r} is not an effect of the catalogue", cure=f"Give one of: {known}.")
    parts = []
    if not row.tested:
        parts.append(f"{effect} cannot be tested with these recordings: {row.reason}.")
    elif any(found.effect == effect for found in diagnosis.missing):
        parts.append(f"{effect} is named: {_p(row.p_value)} under the model without it.")
    else:
        parts.append(f"{effect} is not named: {row.reason}; {_p(row.p_value)} under the model without it.")
    if np.isfinite(row.gain_fit):
        parts.append(
            f"A refit with it, all parameters free, removes {100 * row.gain_fit:.0f} % of the misfit on the fitted and "
            f"{100 * row.gain_holdout:.0f} % on the held-out recordings."
        )
    for found in diagnosis.missing:
        if effect in found.effect_class and found.effect != effect:
            parts.append(
                f"These recordings cannot distinguish it from {found.effect}. {found.split_by}".strip()
            )
    sizes = [
        f"{name} {value:.2g} {'' if row.units.get(name) == '1' else row.units.get(name, '')}".strip()
        for name, value in row.minimum_detectable.items()
        if np.isfinite(value)
    ]
    if sizes:
        parts.append(f"The smallest size that these recordings would show: {', '.join(sizes)}.")
    return " ".join(parts)


def _p(value: float) -> str:
    return f"p = {value:.1g}" if np.isfinite(value) else "not tested"
