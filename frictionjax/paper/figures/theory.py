"""Fig. 2 and the linearisation: what the model says before anything is measured."""

import numpy as np
from matplotlib.figure import Figure

from frictionjax.paper.experiments import Linearised, Presliding
from frictionjax.paper.figures.sheet import BETTER, PAPER, TWIN, legend, sheet, thin


def fig2(found: Presliding) -> Figure:
    """Force against displacement, and the time responses, from `found`."""
    figure, axes = sheet(
        "Fig. 2  Presliding of the LuGre model",
        "Unit mass, Table I, force to 95 % of Fs and back, twice. Table I is lost in our copy of the paper; its "
        "numbers are those of Canudas de Wit et al. (1995). How slow the ramp was is lost too: "
        f"{found.t[-1]:.0f} s for two cycles is ours. At 0.95 Fs the mass is at {1e6 * found.virgin:.3f} µm, in the "
        f"limit of a slow ramp at {1e6 * found.virgin_expected:.3f} µm; after a cycle the bristle is at "
        f"{1e9 * found.z_after_cycle:.0f} nm and the mass at {1e9 * found.x_after_cycle:.0f} nm.",
        size=(7.4, 4.2),
        rows=3,
        columns=2,
    )
    grid = axes[0, 0].get_gridspec()
    for panel in axes[:, 0]:
        panel.remove()
    loop = figure.add_subplot(grid[:, 0])
    loop.plot(
        *thin(1e6 * found.closed_form, found.u),
        color=PAPER,
        lw=3.0,
        alpha=0.45,
        label="closed form, slow limit",
    )
    loop.plot(*thin(1e6 * found.x, found.friction), color=TWIN, lw=0.9, label="simulated")
    loop.plot(1e6 * found.virgin_expected, found.u.max(), "o", ms=4, color=BETTER)
    loop.annotate(
        f"{1e6 * found.virgin_expected:.3f} µm",
        (1e6 * found.virgin_expected, found.u.max()),
        (-46, -14),
        textcoords="offset points",
        fontsize=7.5,
        color=BETTER,
    )
    loop.set(xlabel="displacement x (µm)", ylabel="friction force F (N)")
    loop.set_title("(a)", loc="left", fontsize=8.5)
    legend(loop, loc="lower right")
    for panel, values, label in (
        (axes[0, 1], found.u, "force (N)"),
        (axes[1, 1], 1e6 * found.x, "x (µm)"),
        (axes[2, 1], 1e6 * found.z, "z (µm)"),
    ):
        panel.plot(*thin(found.t, values), color=TWIN, lw=1.0)
        panel.axvline(found.t[-1] / 2.0, color=BETTER, lw=0.7, ls=(0, (4, 2)))
        panel.axhline(0.0, color="#777777", lw=0.5)
        panel.set_ylabel(label)
        panel.tick_params(labelbottom=panel is axes[2, 1])
    axes[0, 1].set_title("(b)  dashed: one cycle is over", loc="left", fontsize=8.5)
    axes[2, 1].set_xlabel("time (s)")
    return figure


def linearisation(found: Linearised) -> Figure:
    """Stiffness and damping at both extremes of the generalized Jacobian, from `found`."""
    figure, axes = sheet(
        "Eq. (3), (4)  The generalized Jacobian at rest",
        "Table I. Where the bristle is straight (z = 0), left and right Jacobian are one matrix: "
        f"{found.natural_frequency:.3f} Hz, damping ratio {found.damping_ratio:.5f}. Elsewhere there are two, and "
        "every convex combination of them: a motion that goes on is felt softer than one that turns back.",
        size=(7.4, 2.7),
        columns=2,
    )
    for panel, left, right, label in (
        (axes[0, 0], 1e-3 * found.stiffness_left, 1e-3 * found.stiffness_right, "stiffness (kN/m)"),
        (axes[0, 1], found.damping_left, found.damping_right, "damping (N s/m)"),
    ):
        panel.fill_between(found.bend, left, right, color="#9a9a9a", alpha=0.25, lw=0)
        panel.plot(found.bend, left, color=PAPER, label="to the left (v < 0)")
        panel.plot(found.bend, right, color=BETTER, ls=(0, (4, 2)), label="to the right (v > 0)")
        panel.plot(0.0, np.interp(0.0, found.bend, left), "o", ms=4, color=TWIN)
        panel.set(xlabel="bristle deflection z sigma0 / Fs (1)", ylabel=label)
    legend(axes[0, 0], loc="upper center")
    return figure
