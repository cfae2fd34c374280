"""Fig. 5 and 6: time-domain experiments on the twins against LuGre with the identified parameters."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from frictionjax.paper.experiments import PARTS, RAMP, SINES, Validation
from frictionjax.paper.experiments.validation import ValidationResponse
from frictionjax.paper.figures.sheet import BETTER, PAPER, TWIN, legend, sheet, thin

_COLOURS = (TWIN, PAPER, BETTER)
_LABELS = ("twin, measured", "LuGre, stiffness at 0.01 V", "LuGre, stiffness at zero amplitude")


def fig5(found: Sequence[Validation]) -> Figure:
    """Break-away by a ramp: the whole motion above, presliding below; a column for each twin of `found`."""
    figure, axes = sheet(
        "Fig. 5  Break-away by a ramp: four machines against LuGre with parameters from their responses",
        f"Twins and the ramp of {RAMP:g} V/s are ours (the paper's slope is lost). Of presliding, LuGre has what "
        "the response of each twin shows; its Fc, Fs, vs and sigma2 are taken as known. In the paper, slopes agree at "
        "small torque and the machine moves further at large torque: here the softening bristle does that. Creep moves "
        "further from the beginning; a LuGre machine moves less than its model of 0.01 V, whose stiffness is low.",
        size=(10.0, 4.9),
        rows=2,
        columns=len(found),
        sharey="row",
    )
    for (whole, small), one in zip(axes.T, found, strict=True):
        volt = 1e3 * one.ramp.u
        for x, style in _curves(one.ramp):
            whole.plot(*thin(one.ramp.t, 1e3 * x, 3000), **style)
            small.plot(*thin(1e3 * x, volt, 4000), **style)
        whole.set_title(one.twin.name, loc="left", fontsize=8.5)
        whole.set(xlabel="time (s)", xlim=(0.0, one.ramp.t[-1]))
        small.set(xlabel="displacement (mrad)", xlim=(0.0, 1.6), ylim=(0.0, 1e3 * one.twin.static_voltage))
        pairs = list(zip(PARTS, one.ramp_ratio, strict=True))[::2]
        words = [f"{100 * part:.0f} % Fs: ×{ratio:.2f}" for part, ratio in pairs]
        text = "\n".join(["twin / model at 0.01 V", *words])
        small.text(0.98, 0.03, text, transform=small.transAxes, fontsize=6.8, ha="right", va="bottom")
    axes[0, 0].set_ylabel("displacement (mrad)")
    axes[1, 0].set_ylabel("voltage (mV)")
    legend(axes[0, 0], loc="upper left")
    return figure


def fig6(found: Sequence[Validation]) -> Figure:
    """Sines in the stick regime: 20 Hz at 0.01 V above, 0.5 Hz at 0.035 V below; a column for each twin of `found`."""
    figure, axes = sheet(
        "Fig. 6  Sines in the stick regime",
        "Above u = 0.01 sin(40 pi t) V, below u = 0.035 sin(pi t) V, 90 % of the static friction (of the second, our "
        "copy lost the pi; 0.5 Hz is the likely reading). Twins are ours. Numbers: peak displacement of the twin over "
        "that of LuGre with the stiffness at 0.01 V, and in brackets at zero amplitude. Slow drift is removed.",
        size=(10.0, 4.6),
        rows=2,
        columns=len(found),
        sharey="row",
    )
    for column, one in zip(axes.T, found, strict=True):
        for panel, name in zip(column, SINES, strict=True):
            frequency, _, periods = SINES[name]
            response = one.small if name == "small" else one.large
            shown = response.t >= (periods - 2) / frequency
            for x, style in _curves(response):
                panel.plot(*thin(response.t[shown], 1e3 * (x[shown] - np.mean(x[shown]))), **style)
            panel.set_xlabel("time (s)")
            words = f"×{one.ratio(name):.2f} ({one.ratio(name, 'extrapolated'):.2f})"
            panel.text(0.98, 0.97, words, transform=panel.transAxes, fontsize=7.5, ha="right", va="top")
        column[0].set_title(one.twin.name, loc="left", fontsize=8.5)
    axes[0, 0].set_ylabel("x at 20 Hz (mrad)")
    axes[1, 0].set_ylabel("x at 0.5 Hz (mrad)")
    for panel in axes[:, 0]:
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + 0.25 * (high - low))
    legend(axes[1, 0], loc="upper left")
    return figure


def _curves(response: ValidationResponse) -> Iterator[tuple[Float[np.ndarray, " n"], dict[str, Any]]]:
    """Each curve of a response and how it is drawn."""
    curves = (response.measured, response.paper, response.extrapolated)
    for x, colour, label, width in zip(curves, _COLOURS, _LABELS, (1.6, 1.1, 1.1), strict=True):
        yield x, {"color": colour, "label": label, "lw": width}
