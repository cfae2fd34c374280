"""The real ball-screw drive EMPS: structure and parameters from the training file alone, judged on the pulses file.

    python benchmarks/emps.py CASE.toml

Structure: the effects that the diagnosis' half-and-half cross-validation of the training file keeps (time-invariant,
static friction above Coulomb friction); parameters by `fit` from two starts. Both files start in motion: position and
speed at the start are read off the first 10 ms of each file, by `fit` and here alike.
"""

import argparse
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import frictionjax as fj
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start import starting_values
from frictionjax.physics import catalogue
from frictionjax.simulation import observer_gains, predict_ahead

SKIP, HORIZON, STRIDE, BANDWIDTH = 20, 0.1, 0.05, 50.0


def _forms() -> dict[str, type]:
    return {form.__name__: form for forms in catalogue().values() for form in forms}


def scores(drive, recording) -> tuple[float, float]:
    """Free-run and 0.1 s-ahead rms errors in mm, without the first 20 samples; causal observer of 50 Hz."""
    rate = recording.sample_rate
    batch = make_batch((recording,))
    x0, v0 = float(batch.x0[0]), float(batch.v0[0])
    z0 = float(np.sign(v0)) * float(drive.level(jnp.asarray(x0), jnp.asarray(v0)) / drive.friction.sigma0)
    free = np.asarray(fj.simulate(drive, recording.u, rate, x0=x0, v0=v0, z0=z0, substeps=2).x)
    gains = observer_gains(BANDWIDTH, 1.0 / rate)
    ahead = predict_ahead(
        drive,
        drive.applied_force(jnp.asarray(recording.u), jnp.asarray(1.0 / rate)),
        recording.x,
        1.0 / rate,
        gains,
        (x0, v0, z0),
        horizon=round(HORIZON * rate),
        stride=round(STRIDE * rate),
        substeps=2,
    )
    # At exactly 0.1 s: the first sample of each run that is told.
    told = slice(round(HORIZON * rate), None, round(STRIDE * rate))
    error = 1e3 * (free - recording.x)[SKIP:], 1e3 * (np.asarray(ahead) - recording.x)[told]
    return float(np.sqrt(np.mean(error[0] ** 2))), float(np.sqrt(np.mean(error[1] ** 2)))


def half(recording, first: bool):
    """The first or the second half of a recording."""
    middle = recording.x.size // 2
    part = slice(None, middle) if first else slice(middle, None)
    return fj.Recording(
        recording.name, recording.sample_rate, recording.u[part], recording.x[part], loop=recording.loop
    )


def main() -> int:
    """Fit the structures, rank them by cross-validation inside the training file, judge the best on the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", type=Path)
    fj.configure_jax()
    case = fj.load_case(parser.parse_args().case)
    (train,), (test,) = case.fit_recordings, case.holdout_recordings
    start = starting_values((train,), motor_constant=case.plant.motor_constant or 1.0).drives[0]
    forms, scales = _forms(), plant_scales(start, make_batch((train,)))
    stroke = {"center": scales["center"], "half_stroke": 0.5 * scales["stroke"]}
    steps = [
        ("nothing", ()),
        ("load", (forms["ConstantLoad"](),)),
        ("load, viscous asymmetry", (forms["ConstantLoad"](), forms["ViscousAsymmetry"]())),
        (
            "load, viscous asymmetry, position",
            (forms["ConstantLoad"](), forms["ViscousAsymmetry"](), forms["PositionDependence"](**stroke)),
        ),
    ]
    found = []
    for name, effects in steps:
        drive = start.with_effects(*effects)
        valid = []
        for first in (True, False):
            result = fj.fit(drive, [half(train, first)], encoder_step=case.plant.encoder_step)
            valid.append(scores(result.drive, half(train, not first))[1])
        result = fj.fit(drive, [train], encoder_step=case.plant.encoder_step)
        found.append((float(np.sqrt(np.mean(np.square(valid)))), name, result))
        sys.stdout.write(
            f"{name}: 0.1 s ahead on the other half {found[-1][0]:.4f} mm; J {result.drive.J:.3f} kg; "
            f"train {scores(result.drive, train)}; {result.message}\n"
        )
        sys.stdout.flush()
    _, name, result = min(found, key=lambda one: one[0])
    free, ahead = scores(result.drive, test)
    sys.stdout.write(
        f"chosen on the training file: {name}\npulses: free run {free:.2f} mm, 0.1 s ahead {ahead:.4f} mm\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
