"""The motor bench: its best linear approximation, and distortion against noise."""

import numpy as np
from matplotlib.figure import Figure

from frictionjax.paper.experiments import PUBLISHED, MotorBench
from frictionjax.paper.figures.sheet import BETTER, COLOURS, PAPER, TWIN, legend, sheet


def fig_bench(found: MotorBench) -> Figure:
    """Response of `found`, and the motor's speed on excited, silent odd and silent even lines."""
    figure, axes = sheet(
        "A real machine  Best linear approximation of a motor bench",
        "Two inertias on a flexible coupling, random-phase odd multisine (recordings of W. Ohnishi's FdiTools, MIT). "
        f"Antiresonance {hertz(found.antiresonance)}, resonance {hertz(found.resonance)}, on lines 4 Hz apart; about "
        f"{PUBLISHED['antiresonance']:.0f} and {PUBLISHED['resonance']:.0f} Hz were published. On silent lines, odd "
        f"distortion is {found.odd:.1f} times the noise and even distortion {found.even:.1f} times; about "
        f"{PUBLISHED['odd']:.0f} and {PUBLISHED['even']:.0f} were published. Friction is an odd nonlinearity.",
        size=(8.0, 3.4),
        columns=2,
    )
    left, right = axes[0]
    bla = found.bla
    frequency, response = np.asarray(bla.frequency), np.asarray(bla.response)
    left.plot(frequency, np.abs(response), ".-", color=TWIN, lw=0.9, ms=4)
    for place, colour, label in (
        (found.antiresonance, PAPER, "antiresonance"),
        (found.resonance, BETTER, "resonance"),
    ):
        if place is not None:
            left.axvline(place, color=colour, lw=0.9, ls=(0, (4, 2)), label=label)
    left.set(yscale="log", xlabel="frequency (Hz)", ylabel="|speed / current| (rad/s/A)", xlim=(0.0, 255.0))
    legend(left, loc="upper right")
    right.semilogy(frequency, np.asarray(bla.output), "o", ms=3, color=TWIN, label="excited lines")
    for kind, colour, label in ((bla.odd, COLOURS[1], "silent odd"), (bla.even, COLOURS[0], "silent even")):
        right.semilogy(
            np.asarray(kind.frequency),
            np.asarray(kind.level),
            ".",
            ms=3,
            color=colour,
            label=f"{label} lines",
        )
    right.semilogy(
        np.asarray(bla.even.frequency),
        np.asarray(bla.even.noise),
        "-",
        lw=0.8,
        color="#8a8a8a",
        label="noise",
    )
    right.set(xlabel="frequency (Hz)", ylabel="motor speed on a line, rms (rad/s)")
    right.set_ylim(2e-5, 30.0)
    legend(right, loc="upper right", ncols=2)
    return figure


def hertz(frequency: float | None) -> str:
    """A frequency with its unit, or "none"."""
    return "none" if frequency is None else f"{frequency:.1f} Hz"
