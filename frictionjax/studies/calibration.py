"""Simulation-based calibration of `diagnose`: are stated errors and confidences as large as they should be?

Machines are drawn from a stated prior (`prior.py`), simulated and diagnosed. Where the stated uncertainty is right, the
true value has any rank in the stated distribution with the same probability (Talts and others, arXiv:1804.06788); of
the names with confidence c a share c is right; and few names are given where nothing acts. The distribution that a
diagnosis states is normal, so that the rank is known without draws from it: the probability of what is below the true
value.

Ranks are counted of machines whose name is right, as in others there is no true value of what was estimated: they say
how right the errors are once the name is.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Float

from frictionjax.core import InputError, public_verb
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid
from frictionjax.diagnosis.checked import LEVEL, binomial_interval
from frictionjax.studies.axes import Axis
from frictionjax.studies.calibration_task import RANKED, CalibrationTask
from frictionjax.studies.design import RandomDesign
from frictionjax.studies.diagnosed_case import classes_in
from frictionjax.studies.prior import FAMILIES
from frictionjax.studies.study import Study

BINS = 10
"""Of a rank histogram."""
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Of the confidences of a reliability diagram."""


class RankHistogram(NamedTuple):
    """Ranks of the true values of one parameter.

    **Attributes:** `parameter`, `counts` (of machines with a rank in each of `BINS` equal parts from 0 to
    1), `low` and `high` (between which 95 % of the counts of one bin lie where the errors are right), `p_value`
    (of counts as uneven as these where the errors are right: chi-square), `inside` (share of the true values within the
    stated 95 % interval), `inside_error` (its Monte Carlo standard error where the errors are right).
    """

    parameter: str
    counts: tuple[int, ...]
    low: float
    high: float
    p_value: float
    inside: float
    inside_error: float


class Reliability(NamedTuple):
    """Names with a confidence within one of the bins.

    **Attributes:** `low`, `high` (edges of the bin), `names` (how many), `confidence` (their mean), `right` (share that
    is right), `interval` (its 95 % interval).
    """

    low: float
    high: float
    names: int
    confidence: float
    right: float
    interval: tuple[float, float]


class FalseNames(NamedTuple):
    """How often a name is given to what does not act, in machines of one kind.

    **Attributes:** `family` (of experiments, or `"all"`), `acting` (`"nothing"`, `"an effect"` or `"any"`), `machines`,
    `wrong` (of which a name is not of what acts, within its class), `right` (that were diagnosed right), `interval`
    (95 % interval of the share of the wrong ones).
    """

    family: str
    acting: str
    machines: int
    wrong: int
    right: int
    interval: tuple[float, float]


class Calibration(AbstractDisplayed):
    """How well `diagnose` is calibrated.

    **Attributes:** `draws` (machines that were diagnosed), `failed` (that could not be), `ranks` (one `RankHistogram` a
    parameter), `reliability` (one `Reliability` a bin with names), `excess` (mean of the confidences minus the share of
    the names that is right: above zero where they are too high) and its standard error where confidences are right,
    `excess_error`, `false_names` (by family).
    """

    draws: int = eqx.field(static=True)
    failed: int = eqx.field(static=True)
    ranks: tuple[RankHistogram, ...] = eqx.field(static=True)
    reliability: tuple[Reliability, ...] = eqx.field(static=True)
    excess: float = eqx.field(static=True)
    excess_error: float = eqx.field(static=True)
    false_names: tuple[FalseNames, ...] = eqx.field(static=True)

    def plot(self, **how: Any) -> Any:
        """Draw the rank histograms with their bands, the reliability diagram, and the rate of false names:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What it comes to, in words."""
        (whole,) = [one for one in self.false_names if (one.family, one.acting) == ("all", "any")]
        said = [
            f"Of {self.draws} machines of the prior {whole.right} were diagnosed right and {whole.wrong} were given a "
            f"false name; {self.failed} could not be diagnosed."
        ]
        if np.isfinite(self.excess):
            said.append(
                f"Confidences are on average {abs(self.excess):.2f} too {'high' if self.excess > 0.0 else 'low'} "
                f"(standard error {self.excess_error:.2f})."
            )
        return tuple(said)

    def _display(self) -> Display:
        ranks, bins = [], []
        for rank in self.ranks:
            inside = f"{100 * rank.inside:.0f} +- {100 * rank.inside_error:.0f} %"
            ranks.append((rank.parameter, str(sum(rank.counts)), inside, f"{rank.p_value:.2g}"))
        for one in self.reliability:
            numbers = (str(one.names), f"{one.confidence:.2f}", f"{one.right:.2f}", _between(one.interval))
            bins.append((f"{one.low:g} to {one.high:g}", *numbers))
        false = tuple(
            (
                one.family,
                one.acting,
                str(one.machines),
                str(one.right),
                str(one.wrong),
                _between(one.interval),
            )
            for one in self.false_names
        )
        grids = (
            TextGrid(("parameter", "ranks", "within the 95 % interval", "p of even ranks"), tuple(ranks)),
            TextGrid(("confidence", "names", "mean", "share right", "95 % interval"), tuple(bins)),
            TextGrid(
                ("family", "what acts", "machines", "right", "false names", "95 % interval of their share"),
                false,
            ),
        )
        return Display("Calibration of `diagnose`", self.sentences, grids)


def calibration_study(draws: int, *, seed: int = 0) -> Study:
    """The study that calibrates `diagnose` with so many machines of the prior: run it by `run_study`, and summarise it
    by `calibration_of`.

    **Arguments:**

    - `draws`: how many machines are drawn and diagnosed; each takes as long as a diagnosis.
    - `seed`: of the draws.

    **Raises:** `InputError` for a number of draws below 1.
    """
    if isinstance(draws, bool) or not isinstance(draws, int) or draws < 1:
        raise InputError(f"`draws` is {draws!r}", cure="Give a whole number from 1 on")
    design = RandomDesign(Axis("family", tuple(FAMILIES)), cases=draws, design_seed=seed)
    return Study(design, CalibrationTask(), seed=seed)


def calibration_of(results: Any) -> Calibration:
    """How well `diagnose` is calibrated, from the `results` of a `calibration_study`, an xarray `Dataset`.

    **Raises:** `InputError` for results of another study, and where no machine could be diagnosed.
    """
    if "failed" not in results or "acting" not in results:
        raise InputError(
            "these are no results of a calibration",
            place="`results`",
            cure="Give what `run_study` or `load_study` returns of a `calibration_study`",
        )
    failed = results["failed"].values
    if failed.all():
        raise InputError(
            f"none of the {failed.size} machines could be diagnosed: {results['reason'].values[0]}",
            place="`results`",
            cure="Correct that, and run the study again",
        )
    fine = ~failed
    ranks = np.asarray(results["rank"].values, float)[fine]
    confidence, right = (np.asarray(results[n].values, float)[fine] for n in ("confidence", "name_right"))
    named = np.isfinite(confidence) & np.isfinite(right)
    confidence, right = confidence[named], right[named]
    excess = excess_error = float("nan")
    if confidence.size:
        excess = float(np.mean(confidence) - np.mean(right))
        excess_error = float(np.sqrt(np.sum(confidence * (1.0 - confidence))) / confidence.size)
    return Calibration(
        int(fine.sum()),
        int(failed.sum()),
        tuple(
            rank_histogram(name, own[np.isfinite(own)])
            for name, own in zip(RANKED, ranks.T, strict=True)
            if np.isfinite(own).any()
        ),
        _reliability(confidence, right),
        excess,
        excess_error,
        _false_names(results, fine),
    )


def rank_histogram(parameter: str, ranks: Float[np.ndarray, " n"]) -> RankHistogram:
    """The histogram of the `ranks` of a `parameter`, numbers from 0 to 1."""
    counts = np.histogram(ranks, np.linspace(0.0, 1.0, BINS + 1))[0].tolist()
    low, high = scipy.stats.binom.interval(LEVEL, ranks.size, 1.0 / BINS)
    half = 0.5 * (1.0 - LEVEL)
    inside = float(np.mean((ranks >= half) & (ranks <= 1.0 - half)))
    error = float(np.sqrt(LEVEL * (1.0 - LEVEL) / ranks.size))
    p_value = float(scipy.stats.chisquare(counts).pvalue)
    return RankHistogram(parameter, tuple(counts), float(low), float(high), p_value, inside, error)


def _reliability(
    confidence: Float[np.ndarray, " n"], right: Float[np.ndarray, " n"]
) -> tuple[Reliability, ...]:
    place = np.clip(np.searchsorted(EDGES, confidence, side="right") - 1, 0, len(EDGES) - 2)
    rows = []
    for number in np.unique(place):
        own = place == number
        rows.append(
            Reliability(
                EDGES[number],
                EDGES[number + 1],
                int(own.sum()),
                float(np.mean(confidence[own])),
                float(np.mean(right[own])),
                binomial_interval(int(right[own].sum()), int(own.sum())),
            )
        )
    return tuple(rows)


def _false_names(results: Any, fine: np.ndarray) -> tuple[FalseNames, ...]:
    family = np.array([str(text) for text in results["family"].values[fine]])
    acting = [str(text) for text in results["acting"].values[fine]]
    classes = [classes_in(str(text)) for text in results["classes"].values[fine]]
    wrong = np.array(
        [any(own not in members for members in some) for own, some in zip(acting, classes, strict=True)], bool
    )
    right = results["right"].values.astype(bool)[fine]
    nothing = np.array([own == "" for own in acting])
    rows = []
    for name in ("all", *FAMILIES):
        of_family = np.full(family.size, True) if name == "all" else family == name
        for kind, of_kind in (("any", nothing | True), ("nothing", nothing), ("an effect", ~nothing)):
            own = of_family & of_kind
            if count := int(own.sum()):
                false = int(wrong[own].sum())
                rows.append(
                    FalseNames(
                        name, kind, count, false, int(right[own].sum()), binomial_interval(false, count)
                    )
                )
    return tuple(rows)


def _between(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.2f} to {interval[1]:.2f}"
