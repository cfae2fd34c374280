"""`rank_experiments`: which of several candidate experiments adds most information to what is known.

The gain of an experiment is the increase of the information criterion. Information is additive over experiments, so
the best next one, and the best sequence, need no more simulations.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError, require_x64
from frictionjax.core.progress import Progress, reporting
from frictionjax.information.candidate_experiments import (
    CandidateInputs,
    Rejected,
    broken_limits,
    candidates_of,
    limits_of,
)
from frictionjax.information.criteria import (
    Criterion,
    Kind,
    Question,
    bounds_in_words,
    known_rows,
    question_of,
)
from frictionjax.information.fisher import Information, assembled, planned_records
from frictionjax.information.planned import Numbers, layout_of, plan_of, values_of
from frictionjax.physics import Drive


class RankedExperiment(eqx.Module):
    """A candidate experiment and the information it adds.

    **Attributes:**

    - `name`: of the candidate.
    - `gain`: increase of the criterion: nats, or for A the decrease of the mean variance (in units of the squared
        value; of the squared typical size for a strength).
    - `std`: name -> least standard deviation once it is made, as in `Information.std`; `inf` where not identifiable.
    - `sentence`: the same in words.
    """

    name: str = eqx.field(static=True)
    gain: float = eqx.field(static=True)
    std: dict[str, float] = eqx.field(static=True)
    sentence: str = eqx.field(static=True)


class Ranking(eqx.Module):
    """Candidate experiments, best first.

    **Attributes:**

    - `entries`: a `RankedExperiment` for each of the `k` candidates that are allowed, the largest gain first.
    - `rejected`: a `Rejected` for each candidate that exceeds a limit.
    - `criterion`: `"D"`, `"parameter"` or `"A"`, which they are ranked by.
    - `of`: names of the parameters asked for; None: all.
    - `information`: `Information` of the candidates alone, one part for each entry, in their order.
    - `roots`: of these parts, shape `(k, p, p)`, with `root' root` the part.
    - `known`: `Information` of what was known before; None: nothing.
    """

    entries: tuple[RankedExperiment, ...]
    rejected: tuple[Rejected, ...]
    criterion: Kind = eqx.field(static=True)
    of: tuple[str, ...] | None = eqx.field(static=True)
    information: Information
    roots: Float[np.ndarray, "k p p"]
    known: Information | None

    @property
    def best(self) -> RankedExperiment:
        """The entry that gains most."""
        return self.entries[0]

    def plan(self, n: int) -> tuple[RankedExperiment, ...]:
        """The best sequence of `n` experiments, found greedily: each is the one that adds most to all before it.

        An experiment may come again. For D no sequence of `n` gains more than 1.6 times as much (Nemhauser, Wolsey and
        Fisher 1978: the logarithm of the determinant is submodular). `gain` is that of the step, `std` the bound after
        it. `InputError` when `n` is below 1.
        """
        if n < 1:
            raise InputError(f"it is {n}", place="`n`", cure="Plan at least one experiment.")
        info, question = self.information, Question(self.criterion, self.of)
        judge, steps = question.criterion(info.names, info.scale), []
        information, rows = self.known, known_rows(self.known, info.names, info.values)
        for step in range(1, n + 1):
            gains = _gains(judge, rows, self.roots)
            best = int(np.argmax(gains))
            rows = np.asarray(np.linalg.qr(np.concatenate([rows, self.roots[best]]), mode="r"))
            information = _with(information, info.of(best))
            steps.append(
                _entry(self.entries[best].name, gains[best], information, question, f"Step {step}: ")
            )
        return tuple(steps)


def rank_experiments(
    drive: Drive,
    candidates: Mapping[str, CandidateInputs],
    sample_rate: Numbers,
    noise: Numbers,
    *,
    criterion: Kind = "D",
    of: str | Sequence[str] | None = None,
    known: Information | None = None,
    free: Sequence[str] | None = None,
    limits: Mapping[str, float] | None = None,
    x0: Numbers = 0.0,
    v0: Numbers = 0.0,
    z0: Numbers | None = None,
    substeps: int = 2,
    progress: Progress | bool = True,
) -> Ranking:
    """Rank candidate experiments on `drive` by the information they would add to what is known.

    With I the information of what is known, I_c that of a candidate (`fisher_information`) and P = 1/9 of the unit
    matrix (a weak prior of three times the size of each parameter, so that a singular information has a value):

    - `"D"`: gain = 1/2 log det(I + I_c + P) - 1/2 log det(I + P), nats: the expected gain in Shannon information about
      all free parameters (Chaloner and Verdinelli, Statistical Science 10, 1995);
    - `"parameter"`: the same about the parameters `of` only, with all others unknown: log of the factor by which the
      volume of their confidence region shrinks (for one parameter: its standard deviation);
    - `"A"`: decrease of the mean variance of the parameters `of`, relative where positive. The
      parameters known worst dominate it.

    All of it is linear theory at the values of `drive`: where that guess is far off, rank again after a fit.
    Candidates of the same length share one compiled program; other numbers compile nothing anew.

    **Arguments:**

    - `drive`: the `Drive`, with the parameter values that are expected.
    - `candidates`: name -> input of shape `(n,)`, input units, or a list of inputs that are recorded one after the
        other and count as one experiment.
    - `sample_rate`: samples per second; one number, or one for each record, counted through all candidates.
    - `noise`: standard deviation of the white noise of the measured position, position units; likewise.
    - `criterion`: `"D"`, `"parameter"` or `"A"`.
    - `of`: name or names of the parameters of interest, for `"parameter"` and `"A"` (None: all).
    - `known`: `Information` of the existing recordings, about the same parameters; None: nothing is known.
    - `free`: names of the unknown parameters, as in `fisher_information`; None: those of `known`, or its default.
    - `limits`: largest magnitudes that the machine allows, of `"x"` (position units), `"v"` (position/s), `"u"` (input
        units); a candidate that exceeds one is rejected with the reason.
    - `x0`, `v0`: known position and velocity at each start, position units and position/s; likewise.
    - `z0`: known bristle deflection at each start, position units; None: as in `fisher_information`.
    - `substeps`: steps per sample, see `simulate`.
    - `progress`: called after each record; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    A `Ranking`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` as in `fisher_information`, and when there is no
    candidate, the criterion, a parameter or a limit is not known, `known` is about other parameters or values, or a
    limit rejects every candidate.
    """
    require_x64()
    choice, allowed = candidates_of(candidates), limits_of(limits)
    start = {"x0": x0, "v0": v0, "z0": z0, "substeps": substeps}
    plan = plan_of(choice.inputs, sample_rate, noise, labels=choice.labels, **start)
    layout = layout_of(drive, known.names if free is None and known is not None else free)
    names = tuple(one.label for one in layout)
    before = known_rows(known, names, values_of(layout, drive))
    question = question_of(criterion, of, names)
    records = []
    with reporting(progress) as report:
        for index, record in enumerate(planned_records(layout, drive, plan)):
            records.append(record)
            report(f"information of {plan.labels[index]}", (index + 1) / len(plan.inputs))
    kept, rejected = [], []
    for name, group in zip(choice.names, choice.groups, strict=True):
        peaks = {
            "x": float(np.max([records[i].peak_x for i in group])),
            "v": float(np.max([records[i].peak_v for i in group])),
            "u": max(float(np.max(np.abs(plan.inputs[i]))) for i in group),
        }
        broken = broken_limits(name, peaks, allowed)
        (kept if broken is None else rejected).append((name, group) if broken is None else broken)
    if not kept:
        raise InputError(
            " ".join(one.sentence for one in rejected),
            place="`limits`",
            cure="Give a weaker candidate, or a wider limit.",
        )
    places = [i for _, group in kept for i in group]
    found = assembled(layout, drive, plan.of(places), [records[i] for i in places])
    parts = np.stack([sum((records[i].matrix for i in group), np.zeros_like(before)) for _, group in kept])
    roots = np.stack(
        [np.linalg.qr(np.concatenate([records[i].root for i in group]), mode="r") for _, group in kept]
    )
    found = eqx.tree_at(lambda i: i.parts, found, parts)
    if known is not None:  # one size of a strength for both: that of the existing recordings
        found = eqx.tree_at(lambda i: i.scale, found, known.scale)
    gains = _gains(question.criterion(names, found.scale), before, roots)
    order = [int(i) for i in np.argsort(-gains, kind="stable")]
    entries = tuple(_entry(kept[i][0], gains[i], _with(known, found.of(i)), question) for i in order)
    return Ranking(
        entries, tuple(rejected), question.kind, question.of, found.of(*order), roots[order], known
    )


def _with(known: Information | None, more: Information) -> Information:
    return more if known is None else known + more


def _gains(
    judge: Criterion, rows: Float[np.ndarray, "p p"], roots: Float[np.ndarray, "k p p"]
) -> Float[np.ndarray, " k"]:
    """The gain of each of `roots`, shape `(k, p, p)`, over `rows`, shape `(p, p)`."""
    before = float(judge(rows))
    gains = [float(judge(np.concatenate([rows, root]))) - before for root in roots]
    return np.maximum(gains, 0.0)  # negative gains are rounding errors


def _entry(
    name: str, gain: float, information: Information, question: Question, before: str = ""
) -> RankedExperiment:
    gained = question.in_words(float(gain), information.names)
    sentence = f"{before}{name} {gained}; {bounds_in_words(information, question.of)}."
    return RankedExperiment(name, float(gain), information.std, sentence)
