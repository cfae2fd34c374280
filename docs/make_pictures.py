"""Draw docs/pictures/effects/NAME.png for every effect: `python docs/make_pictures.py [NAME ...]`.

One arm is driven without and with the effect, by the same input. What is drawn is what a recording shows: the torque
that input and motion leave over, `km u - J x''`, against velocity and against position, from the position that a sensor
would report. Nothing is fitted and there is no noise.
"""

import sys
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import frictionjax as fj

fj.configure_jax()

PICTURES = Path(__file__).parent / "pictures" / "effects"
RATE = 2000.0  # Hz
ARM = fj.Drive(
    J=0.02,
    friction=fj.LuGre(sigma0=1000.0, sigma1=4.0, sigma2=0.6, Fc=1.0, Fs=1.4, vs=0.2),
    motor_constant=1.0,
)
"""A servo arm: N m, rad, s; its input is a torque."""

SIZES: dict[str, dict[str, float]] = {
    "backlash": {"ratio": 0.4, "gap": 0.01, "frequency": 15.0},
    "constant_load": {"load": 0.2},
    "creep": {"compliance": 1.0, "time_constant": 0.15},
    "delay": {"delay": 0.02},
    "direction_asymmetry": {"coulomb": 0.2},
    "drive_deadzone": {"width": 0.25},
    "drive_lag": {"time_constant": 0.02},
    "drive_saturation": {"cut": 0.25, "largest": 2.2},
    "dwell_strengthening": {"growth": 0.05, "onset": 0.01, "length": 1.4e-3},
    "elasto_plastic": {"plasticity": 1.0, "core": 0.6},
    "encoder_error": {"sine": 3e-4, "period": 0.05},
    "flexible_transmission": {"ratio": 0.5, "frequency": 6.0},
    "friction_lag": {"lag": 0.05},
    "gravity_pendulum": {"sine": 0.6},
    "load_dependence": {"growth": 0.2},
    "mains_pickup": {"sine": 1e-4, "frequency": 50.0},
    "maxwell_slip": {"share": 0.7},
    "micro_damping": {"fall": 0.95, "speed": 0.02},
    "nonlinear_bristle": {"hardening": 2.0},
    "position_dependence": {"linear": 0.3, "center": 0.3, "half_stroke": 0.4},
    "quadratic_drag": {"drag": 0.4},
    "return_spring": {"stiffness": 1.0},
    "ripple": {"sine": 0.2, "period": 0.1},
    "sensor_lag": {"lag": 0.02},
    "stribeck_shape": {"blend": 1.5},
    "torque_ripple": {"sine": 0.15, "period": 0.1},
    "viscoelastic_damping": {"stiffness": 0.15, "shortest": 0.005},
    "warmup": {"fall": 0.4, "time_constant": 4.0},
}
"""Effect -> values that show in a picture, of its first form; what is left out has its default."""


def drive_input() -> tuple[Float[np.ndarray, " n"], dict[str, slice]]:
    """The input, N m: loops within a loop below break-away, a step, a rest, then moves, and where each is.

    **Returns:** the input, shape `(n,)`, and the samples of `"stick"` and of `"sliding"`.
    """
    corners = np.array([0.0, 0.8, -0.8, 0.5, -0.3, 0.8, -0.8, 0.0])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / 1.6)])
    loops = np.interp(np.arange(0.0, times[-1], 1.0 / RATE), times, corners)
    knock, rest = np.full(int(0.15 * RATE), 0.4), np.zeros(int(0.5 * RATE))
    t = np.arange(0.0, 6.0, 1.0 / RATE)
    moves = 2.0 * np.sin(2.0 * np.pi * 0.5 * t)
    first = loops.size + knock.size + rest.size
    whole = np.concatenate([loops, knock, rest, moves])
    return whole, {"stick": slice(20, first), "sliding": slice(first, whole.size - 1)}


def balance(drive: fj.Drive, u: Float[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Position, velocity and `km u - J x''` of a run, as a sensor without noise shows them.

    **Arguments:**

    - `drive`: the machine.
    - `u`: input, shape `(n,)`.

    **Returns:** `x` (rad), `v` (rad/s) and `force` (N m), each of shape `(n,)`.
    """
    x = np.asarray(fj.simulate(drive, u, RATE, substeps=8).measured)
    v, a = np.gradient(x, 1.0 / RATE), np.zeros_like(x)
    a[1:-1] = np.diff(x, 2) * RATE**2
    held = np.concatenate(
        [u[:1], 0.5 * (u[1:] + u[:-1])]
    )  # what acts on the mean between the neighbours of a sample
    return {"x": x, "v": v, "force": float(ARM.motor_constant) * held - float(ARM.J) * a}


def with_effect(name: str) -> fj.Drive:
    """The arm with the effect `name`, in its first form and with the values in `SIZES`."""
    return ARM.with_effects(fj.catalogue()[name][0](**SIZES[name]))


def draw(name: str, base: dict[str, Float[np.ndarray, " n"]], folder: Path = PICTURES) -> Path:
    """Draw one effect.

    **Arguments:**

    - `name`: its name in the catalogue.
    - `base`: what `balance` gives for the arm without it.
    - `folder`: where `NAME.png` goes.

    **Returns:** the file.
    """
    u, parts = drive_input()
    found = balance(with_effect(name), u)
    figure = Figure(figsize=(8.4, 2.7), dpi=76, layout="constrained")
    stribeck, stroke, loops = figure.subplots(1, 3)
    for label, run, style in (("base model", base, _BASE), (f"with {name}", found, _EFFECT)):
        for axes, part, across, unit in (
            (stribeck, "sliding", "v", 1.0),
            (stroke, "sliding", "x", 1.0),
            (loops, "stick", "x", 1e3),
        ):
            axes.plot(unit * run[across][parts[part]], run["force"][parts[part]], label=label, **style)
    _finish(stribeck, "sliding: against velocity", "v (rad/s)")
    _finish(stroke, "sliding: against position", "x (rad)")
    _finish(loops, "stick: against displacement", "x (mrad)")
    stribeck.set_ylabel("km u - J x'' (N m)")
    figure.legend(*stribeck.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.png"
    drawn = BytesIO()
    figure.savefig(drawn)
    Image.open(drawn).convert("RGB").quantize(24).save(file, optimize=True)
    return file


_BASE = {"color": "#8a8a8a", "linewidth": 1.6}
_EFFECT = {"color": "#0072b2", "linewidth": 1.1}


def _finish(axes: Axes, title: str, across: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(across)
    axes.set_ylim(-2.2, 2.2)
    axes.axhline(0.0, color="#cccccc", linewidth=0.6, zorder=0)


def main(names: list[str]) -> None:
    """Draw the effects `names`, or all."""
    matplotlib.rcParams.update({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False})
    base = balance(ARM, drive_input()[0])
    for name in names or SIZES:
        draw(name, base)


if __name__ == "__main__":
    main(sys.argv[1:])
