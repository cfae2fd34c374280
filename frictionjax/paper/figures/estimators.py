"""Four estimators against each other: error, its ratio to the Cramer-Rao bound, and coverage."""

import numpy as np
from matplotlib.figure import Figure

from frictionjax.paper.figures.sheet import COLOURS, sheet
from frictionjax.studies.estimator_comparison import EstimatorComparison

_NAMES = {
    "sk": "SK on the response",
    "frf_ml": "maximum likelihood on the response",
    "breakaway": "full LuGre on the ramp",
    "joint": "full LuGre on ramp and noise",
}


def fig_estimators(found: EstimatorComparison) -> Figure:
    """Error, ratio to the bound and coverage over the noise, from `found`: a column for each parameter."""
    sentences = " ".join(found.sentences)
    took = ", ".join(f"{_NAMES.get(name, name)} {seconds:.0f} s" for name, seconds in found.seconds.items())
    figure, axes = sheet(
        "The comparison  Which estimator, when",
        f"Plant of Table I, {found.converged.shape[2]} draws at each noise level. Above: bias (dotted) and standard "
        "deviation over the true value. Middle: standard deviation over the Cramer-Rao bound. Below: how often "
        f"the 95 % interval covers the truth. {sentences} Running time: {took}.",
        size=(12.5, 6.6),
        rows=3,
        columns=len(found.parameters),
        sharex=True,
        sharey="row",
    )
    noise = 1e9 * found.noise
    bias, std, coverage = (np.asarray(part) for part in (found.bias, found.std, found.coverage))
    for e, (name, colour) in enumerate(zip(found.estimators, COLOURS, strict=False)):
        for p, truth in enumerate(found.truth):
            error, ratio, covers = axes[:, p]
            if not np.isfinite(std[e, :, p]).any():
                continue
            style = {"color": colour, "marker": ".", "ms": 4}
            error.loglog(noise, std[e, :, p] / truth, lw=1.4, label=_NAMES.get(name, name), **style)
            error.loglog(noise, np.abs(bias[e, :, p]) / truth, lw=0.8, ls=":", **style)
            ratio.loglog(noise, std[e, :, p] / found.bound[e, :, p], lw=1.2, **style)
            covers.semilogx(noise, coverage[e, :, p], lw=1.2, **style)
    for p, name in enumerate(found.parameters):
        axes[0, p].set_title(name.replace("+", " + "), loc="left", fontsize=8.5)
        axes[1, p].axhline(1.0, color="#777777", lw=0.7)
        axes[2, p].axhline(0.95, color="#777777", lw=0.7)
        axes[2, p].set_xlabel("noise (nm)")
    axes[0, 0].set_ylabel("error / value (1)")
    axes[1, 0].set_ylabel("std / bound (1)")
    axes[2, 0].set(ylabel="coverage (1)", ylim=(-0.03, 1.05))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=len(labels), frameon=False, fontsize=7)
    return figure
