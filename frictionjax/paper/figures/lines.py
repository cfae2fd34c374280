"""The study in a few lines of a terminal."""

from collections.abc import Sequence

from frictionjax.paper.experiments import PAPER_LEVEL, Explained, MotorBench, Paper
from frictionjax.paper.figures.bench import hertz
from frictionjax.report.format import estimate_text


def paper_lines(
    paper: Paper, explained: Sequence[Explained] = (), bench: MotorBench | None = None
) -> list[str]:
    """What was found, a line each.

    **Arguments:**

    - `paper`: from `reproduce`.
    - `explained`: from `explain`; may be empty.
    - `bench`: from `motor_bench`, if it was asked for.

    **Returns:** the lines.
    """
    slow, linear, sweep = paper.presliding, paper.linearised, paper.sweep
    one, valid = paper.identified[0], paper.validations
    zero = sweep.zero_amplitude("prbs", upto=0.26)
    found = [
        f"Fig. 2: {1e6 * slow.virgin:.2f} µm at 95 % of the static friction; in the slow limit "
        f"{1e6 * slow.virgin_expected:.2f} µm.",
        f"Linearised: {linear.natural_frequency:.3f} Hz, damping ratio {linear.damping_ratio:.5f}.",
        f"Table III, Table I plant: stiffness {sweep.mean('prbs')[-1]:.3g} N/m at {sweep.levels[-1]:g} of the static "
        f"friction, {estimate_text(zero.stiffness)} N/m extrapolated to zero amplitude; truth "
        f"{sweep.true_stiffness:.6g} N/m.",
        f"Fig. 4(b), LuGre twin at {1e3 * PAPER_LEVEL:g} mV: stiffness {estimate_text(one.fit.stiffness)} N m/rad, "
        f"extrapolated {estimate_text(one.zero_amplitude.stiffness)}; truth {one.twin.sigma0:g}.",
        "Fig. 6, displacement of the twin over that of LuGre with the paper's estimates, 0.01 V and 0.035 V:",
    ]
    found += [
        f"  {item.twin.name:<18} {item.ratio('small'):.2f}  {item.ratio('large'):.2f}" for item in valid
    ]
    if paper.comparison is not None:
        found += ["Estimators compared:", *(f"  {sentence}" for sentence in paper.comparison.sentences)]
    if explained:
        found += ["What `diagnose` names:"]
        found += [f"  {item.twin.name:<18} {', '.join(item.named) or 'nothing'}" for item in explained]
    if bench is not None:
        found += [
            f"Motor bench: antiresonance {hertz(bench.antiresonance)}, resonance {hertz(bench.resonance)}, odd "
            f"distortion {bench.odd:.1f} and even distortion {bench.even:.1f} times the noise."
        ]
    return found
