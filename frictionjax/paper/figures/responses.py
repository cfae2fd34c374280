"""Fig. 4: stiffness against the level of the noise, and the measured response with its second-order fit."""

import numpy as np
from jaxtyping import Array, Bool, Complex, Float
from matplotlib import colormaps
from matplotlib.figure import Figure

from frictionjax.frequency import FRF
from frictionjax.paper.experiments import BAND, PAPER_LEVEL, REFERENCE_A5, SAMPLE_RATE, Identified
from frictionjax.paper.figures.sheet import BETTER, COLOURS, PAPER, TWIN, legend, sheet
from frictionjax.report.format import estimate_text
from frictionjax.studies import LevelSweep

_SHOWN = (1.0, 500.0)  # Hz
_NAMES = {"prbs": "PRBS", "gaussian": "Gaussian"}


def fig4a(sweep: LevelSweep, identified: tuple[Identified, ...]) -> Figure:
    """Responses of the LuGre twin at growing levels, and stiffness against level: of Table I from `sweep`, and of the
    twins from `identified`.
    """
    one = identified[0]
    share = 100.0 * PAPER_LEVEL / one.twin.static_voltage
    figure, axes = sheet(
        "Fig. 4(a), Table III  The stiffness falls as the noise grows",
        "Left: the LuGre twin, numbers ours. Middle: the plant of Table I, band of one standard deviation over "
        f"{sweep.stiffness.shape[2]} seeds; crosses are numbers of an independent program for this plant. Right: the "
        f"four twins. The numbers of Table III are lost. The paper's smallest level, 0.01 V, is {share:.0f} % of its "
        "static friction (dotted). Open circles: extrapolated to zero amplitude.",
        size=(9.6, 3.5),
        columns=3,
    )
    left, middle, right = axes[0]
    shades = colormaps["viridis_r"](np.linspace(0.08, 1.0, len(one.levels)))
    for frf, level, shade in zip(one.frfs, one.levels, shades, strict=True):
        inside = _inside(frf)
        magnitude = 1e3 * np.abs(np.asarray(frf.response))[inside]
        left.loglog(
            np.asarray(frf.frequency)[inside], magnitude, color=shade, lw=0.9, label=f"{1e3 * level:g} mV"
        )
    left.set(xlabel="frequency (Hz)", ylabel="|x / u| (mrad/V)", xlim=_SHOWN, ylim=(3e-3, 100.0))
    legend(left, loc="lower left", title="rms", title_fontsize=7)

    for kind, colour in zip(sweep.excitations, (BETTER, PAPER), strict=True):
        mean, std = sweep.mean(kind) / sweep.true_stiffness, sweep.std(kind) / sweep.true_stiffness
        middle.fill_between(sweep.levels, mean - std, mean + std, color=colour, alpha=0.25, lw=0)
        middle.plot(
            sweep.levels,
            mean,
            color=colour,
            marker=".",
            ms=4,
            label=_NAMES[kind],
        )
        zero = sweep.zero_amplitude(kind, upto=0.26)
        middle.errorbar(
            0.0,
            zero.stiffness.value / sweep.true_stiffness,
            zero.stiffness.stderr / sweep.true_stiffness,
            fmt="o",
            ms=5,
            mfc="white",
            color=colour,
        )
    for place, colour in ((1, BETTER), (2, PAPER)):
        points = [(row[0], row[place] / 1e5) for row in REFERENCE_A5]
        middle.plot(*zip(*points, strict=True), "x", ms=5, color=colour, alpha=0.9)
    middle.axvline(share / 100.0, color="#777777", lw=0.8, ls=":")
    middle.set(xlabel="rms of the force / Fs (1)", ylabel="stiffness / sigma0 (1)", ylim=(0.0, 1.08))
    legend(middle, loc="lower left")

    for one, colour in zip(identified, COLOURS, strict=False):
        stiffness = np.array([fit.stiffness.value for fit in one.fits])
        error = np.array([fit.stiffness.stderr for fit in one.fits])
        level = one.levels / one.twin.static_voltage
        right.errorbar(
            level, stiffness / one.twin.sigma0, error / one.twin.sigma0, color=colour, label=one.twin.name
        )
        zero = one.zero_amplitude.stiffness
        right.errorbar(
            0.0,
            zero.value / one.twin.sigma0,
            zero.stderr / one.twin.sigma0,
            fmt="o",
            ms=5,
            mfc="white",
            color=colour,
        )
    right.axvline(share / 100.0, color="#777777", lw=0.8, ls=":")
    right.set(xlabel="rms of the torque / Fs (1)", ylabel="stiffness / sigma0 (1)", ylim=(0.0, 1.08))
    legend(right, loc="lower left")
    return figure


def fig4b(one: Identified) -> Figure:
    """Measured response of the twin `one` at 0.01 V, the fitted system, coherence, and how the fit converged."""
    frf, fit, plain, twin = one.frfs[one.paper], one.fit, one.without_delay[one.paper], one.twin
    figure, axes = sheet(
        f"Fig. 4(b)  Measured and fitted response, {twin.name} twin at {1e3 * PAPER_LEVEL:g} mV",
        "50 averages of 8192 samples at 10 kHz, Hann, 50 % overlap, fit up to 150 Hz: the paper's. The twin is ours: "
        f"its J = {twin.J:g} kg m², sigma0 = {twin.sigma0:g} N m/rad, sigma1 + sigma2 = "
        f"{twin.sigma1 + twin.sigma2:g} N m s/rad, transmission at {twin.antiresonance:.0f} and {twin.resonance:.0f} "
        f"Hz. Fitted with a delay: J = {estimate_text(fit.J)}, stiffness {estimate_text(fit.stiffness)}, damping "
        f"{estimate_text(fit.damping)}, delay {1e6 * fit.delay.value:.0f} µs (the twin has "
        f"{1e6 * twin.delay / SAMPLE_RATE:.0f}: the fit takes up friction's own phase too). Without: "
        f"J = {estimate_text(plain.J)}, stiffness {estimate_text(plain.stiffness)}, damping "
        f"{estimate_text(plain.damping)}. Low coherence without sensor noise to speak of is the friction itself. "
        "Grey: one standard deviation.",
        size=(7.8, 4.9),
        rows=3,
        columns=2,
        width_ratios=(2.2, 1.0),
    )
    inside = _inside(frf)
    f, H, std = (np.asarray(part)[inside] for part in (frf.frequency, frf.response, frf.std))
    magnitude, phase, coherence = axes[:, 0]
    magnitude.fill_between(
        f, 1e3 * np.maximum(np.abs(H) - std, 1e-9), 1e3 * (np.abs(H) + std), color="#bbbbbb", lw=0
    )
    magnitude.loglog(f, 1e3 * np.abs(H), color=TWIN, lw=0.8, label="measured")
    phase.semilogx(f, _degrees(H), color=TWIN, lw=0.8)
    for result, colour, label in ((plain, PAPER, "fit without delay"), (fit, BETTER, "fit with delay")):
        magnitude.loglog(result.frequency, 1e3 * np.abs(result.response), color=colour, lw=1.3, label=label)
        phase.semilogx(result.frequency, _degrees(result.response), color=colour, lw=1.3)
    coherence.semilogx(f, np.asarray(frf.coherence)[inside], color=TWIN, lw=0.8)
    magnitude.set(ylabel="|x / u| (mrad/V)", ylim=(3e-3, 60.0))
    phase.set(ylabel="phase (°)", ylim=(-290.0, 20.0), yticks=[0, -90, -180, -270])
    coherence.set(ylabel="coherence (1)", xlabel="frequency (Hz)", ylim=(0.0, 1.03))
    for panel in axes[:, 0]:
        panel.set_xlim(_SHOWN)
        panel.axvline(BAND[1], color="#777777", lw=0.8, ls=":")
        panel.label_outer()
    legend(magnitude, loc="lower left")
    for panel in axes[:, 1]:
        panel.remove()
    steps = figure.add_subplot(axes[0, 0].get_gridspec()[:, 1])
    for result, colour in ((plain, PAPER), (fit, BETTER)):
        steps.plot(np.arange(result.residual_norm.size), result.residual_norm, "o-", ms=3, color=colour)
    steps.set(xlabel="step of the iteration", ylabel="weighted residual norm (1)")
    steps.set_title("convergence", loc="left", fontsize=8.5)
    return figure


def _inside(frf: FRF) -> Bool[np.ndarray, " bins"]:
    frequency = np.asarray(frf.frequency)
    return (frequency >= _SHOWN[0]) & (frequency <= _SHOWN[1])


def _degrees(response: Complex[Array | np.ndarray, " bins"]) -> Float[np.ndarray, " bins"]:
    """Phase in degrees between -300 and 60: noise around -180 then makes no jumps."""
    return np.mod(np.degrees(np.angle(response)) + 300.0, 360.0) - 300.0
