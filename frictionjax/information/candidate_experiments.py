"""Candidate experiments by name, of one record or several in sequence, and the limits of the machine."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np

from frictionjax.core import InputError
from frictionjax.information.planned import Inputs, Signal

CandidateInputs = Inputs
"""One planned input of shape `(n,)`, or several, each recorded from the known start."""


class Rejected(eqx.Module):
    """A candidate that exceeds a limit of the machine.

    **Attributes:**

    - `name`: of the candidate.
    - `sentence`: which limit it exceeds, and by how much.
    """

    name: str = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


class CandidateExperiments(eqx.Module):
    """All candidates as one list of records.

    **Attributes:** `names`; `inputs` (all records, one after the other) and their `labels`; `groups` (the indices of
    the records of each candidate).
    """

    names: tuple[str, ...]
    inputs: list[Signal]
    labels: list[str]
    groups: list[list[int]]


def candidates_of(candidates: Mapping[str, CandidateInputs]) -> CandidateExperiments:
    """The `candidates` (name -> input or inputs), each of whose records gets a label."""
    if not isinstance(candidates, Mapping) or not candidates:
        raise InputError(
            "there is no candidate",
            place="`candidates`",
            cure='Give a dict of at least one name and its input, such as {"ramp": ramp(...)}.',
        )
    inputs, labels, groups = [], [], []
    for name, given in candidates.items():
        several = (
            list(given) if isinstance(given, Sequence) and not all(np.isscalar(u) for u in given) else [given]
        )
        if isinstance(given, Sequence) and not given:
            raise InputError(
                f"candidate {name!r} has no input",
                place="`candidates`",
                cure="Give it one or more, or leave it out.",
            )
        groups.append(list(range(len(inputs), len(inputs) + len(several))))
        inputs += several
        labels += [
            f"candidate {name!r}" + (f", record {i}" if len(several) > 1 else "") for i in range(len(several))
        ]
    return CandidateExperiments(tuple(candidates), inputs, labels, groups)


_QUANTITIES = {"x": "position", "v": "velocity", "u": "input"}


def limits_of(limits: Mapping[str, float] | None) -> dict[str, float]:
    """The `limits` of the magnitudes of position x, velocity v and input u, checked."""
    limits = dict(limits or {})
    for name, value in limits.items():
        if name not in _QUANTITIES or not value > 0.0:
            raise InputError(
                f"{name!r}: {value}",
                place="`limits`",
                cure='Give positive numbers for some of "x" (position), "v" (velocity) and "u" (input).',
            )
    return limits


def broken_limits(name: str, peaks: Mapping[str, float], limits: Mapping[str, float]) -> Rejected | None:
    """`Rejected` if candidate `name`, whose largest |x|, |v| and |u| are `peaks`, exceeds one of `limits`, or None."""
    over = [
        f"{_QUANTITIES[key]} reaches {peaks[key]:.4g}, the limit is {limit:.4g}"
        for key, limit in limits.items()
        if not peaks[key] <= limit  # an overflow to NaN exceeds any limit
    ]
    return Rejected(name, f"{name} is not allowed: its {' and its '.join(over)}.") if over else None
