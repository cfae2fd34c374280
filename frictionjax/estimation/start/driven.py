"""Starting values from force-driven recordings alone.

FRF and Sanathanan-Koerner on broadband stick recordings give J, stiffness and damping; sliding motion gives J, Fc and
sigma2; the highest force at low speed gives Fs. Where there is no stick recording several stiffnesses are
offered, and the fit chooses.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.estimation.data.batch import noise_level
from frictionjax.estimation.start.sliding import (
    WINDOWS,
    SlidingFit,
    SlidingMotion,
    fit_sliding,
    smooth_motion,
)
from frictionjax.frequency import SKResult, estimate_frf, fit_sk
from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Recording


class StartingValues(eqx.Module):
    """Where a fit may start.

    **Attributes:** `drives` (alternatives, most credible first), `notes` (sentences: what the recordings do not
    determine), `presliding_seen` (whether a recording determines the stiffness in stick), `stick_inertia` (from such a
    recording; None without one).
    """

    drives: tuple[Drive, ...]
    notes: tuple[str, ...] = eqx.field(static=True)
    presliding_seen: bool = eqx.field(static=True)
    stick_inertia: float | None = eqx.field(static=True, default=None)


def starting_values(
    recordings: tuple[Recording, ...], *, motor_constant: float = 1.0, inertia: float | None = None
) -> StartingValues:
    """Starting values for the base fit.

    **Arguments:**

    - `recordings`: force-driven recordings.
    - `motor_constant`: force per input unit (1 when unknown: forces are then per input unit).
    - `inertia`: known inertia, or None.

    **Returns:**

    A `StartingValues`.
    """
    trials = []
    for seconds in WINDOWS:
        motions = tuple(smooth_motion(r, motor_constant, seconds) for r in recordings)
        sliding = fit_sliding(motions, inertia=inertia)
        if not sliding.credible:
            # A machine on a spring, or a pendulum: its restoring force must not be taken for inertia.
            hanging = fit_sliding(motions, inertia=inertia, beside=[m.x[:, None] for m in motions])
            if hanging.credible and hanging.unexplained < CLEARER * sliding.unexplained:
                sliding = hanging
        trials.append((not sliding.credible, sliding.unexplained, motions, sliding))
        if sliding.credible:
            break
    *_, motions, sliding = min(trials, key=lambda trial: trial[:2])
    stick, shaken = _best_stick(recordings, motions, motor_constant)
    stick_inertia = stick.J.value if stick is not None else None
    notes = []
    if not sliding.credible:
        notes.append(
            "Inertia, Coulomb and viscous friction explain little of the force in sliding "
            f"(left unexplained: {100 * min(sliding.unexplained, 1.0):.0f} %)."
        )
    held = _without_sliding(motions, stick, motor_constant) if stick is not None else ()
    still = stick is not None and not _slides(recordings, motions, stick)
    if still and not (sliding.credible and sliding.unexplained < _EXPLAINED):
        notes.append(
            "No recording slides: friction is bounded from below only, and its velocity dependence is unknown."
        )
        return StartingValues(held, tuple(notes), True, stick_inertia)
    # Vibration in stick may pass for sliding, with another inertia and next to no friction; and noise that drives the
    # machine harder than Coulomb friction holds it slides, and its "stiffness" is a fiction. Where the two do not
    # agree, both are offered.
    agree = stick is not None and not still and sliding.credible and 0.4 < stick.J.value / sliding.J < 2.5
    agree = agree and shaken < sliding.Fc
    doubted = () if agree else held
    if stick is not None and sliding.credible and not agree:
        stick = None
    J = sliding.J if sliding.credible or stick is None else stick.J.value
    effort = max(float(np.sqrt(np.mean(m.force**2))) for m in motions)
    acceleration = max(float(np.sqrt(np.mean(m.a**2))) for m in motions)
    if J * acceleration < _LEAST_FORCE * effort:
        # Inertia that would take all of the force to make the measured acceleration.
        J = effort / acceleration
    Fc = max(sliding.Fc, 0.02 * effort)
    Fs = _break_away(motions, J, Fc, sliding)
    # A hundredth of Coulomb friction at top speed is as good as zero, and positive.
    sigma2 = max(sliding.sigma2, 0.01 * Fc / sliding.top_speed)
    vs = 0.03 * sliding.top_speed
    drives = []
    if stick is not None:
        stiffness = stick.stiffness.value
        damping = max(stick.damping.value - sigma2, 0.1 * np.sqrt(stiffness * J))
        for spread in (1.0, 4.0):
            drives.append(Drive(J, LuGre(stiffness, damping, sigma2, Fc, Fs, spread * vs), motor_constant))
    else:
        notes.append(
            "No broadband recording in stick: bristle stiffness and damping act only at reversals, "
            "and are poorly determined."
        )
        stroke = max(float(np.ptp(m.x)) for m in motions)
        within = max(_from_rest(recording) for recording in recordings)
        for part, spread in ((1e-5, 3.0), (1e-4, 1.0), (1e-4, 6.0), (1e-2, 3.0)):
            stiffness = Fs / max(part * stroke, within)
            damping = np.sqrt(stiffness * J)
            drives.append(Drive(J, LuGre(stiffness, damping, sigma2, Fc, Fs, spread * vs), motor_constant))
    return StartingValues((*drives, *doubted), tuple(notes), stick is not None, stick_inertia)


CLEARER = 0.7
"""A force beside friction is assumed where it lowers the unexplained part of the force to less than this part of it."""
_LEAST_FORCE = 1e-3
"""Share of the motor force below which an inertia is not credible: its bound at zero has stopped the fit."""
_EXPLAINED = 0.1
"""Part of the force that sliding may leave unexplained and still be credible where all recordings seem to stay in
stick: large moves have a "stiffness", too, so low that they seem to be the bending of bristles."""
_BOTTOM = 3.0
"""Lowest frequency of the response of a recording in stick that is fitted, Hz."""
_STIFF_UP_TO = 2.0
"""Times that frequency, up to which the force of the bristles must be larger than that of the inertia."""
_DEFLECTIONS = 10.0
"""How many bristle deflections a machine may move before it must have slid."""


def _slides(recordings: tuple[Recording, ...], motions: tuple[SlidingMotion, ...], stick: SKResult) -> bool:
    """Whether any recording moves further than bristles can bend under the largest force in it."""
    return any(
        float(np.ptp(recording.x))
        > _DEFLECTIONS * float(np.max(np.abs(motion.force))) / stick.stiffness.value
        for recording, motion in zip(recordings, motions, strict=True)
    )


def _without_sliding(
    motions: tuple[SlidingMotion, ...], stick: SKResult, motor_constant: float
) -> tuple[Drive, ...]:
    """Starts for a machine that slides in no recording: static friction is at least the largest force that it held."""
    J, stiffness, damping = stick.J.value, stick.stiffness.value, stick.damping.value
    held = max(float(np.max(np.abs(m.force))) for m in motions)
    speed = held / np.sqrt(stiffness * J)
    return tuple(
        Drive(
            J,
            LuGre(stiffness, 0.95 * damping, 0.05 * damping, 0.8 * margin * held, margin * held, 0.1 * speed),
            motor_constant,
        )
        for margin in (1.2, 3.0)
    )


def _best_stick(
    recordings: tuple[Recording, ...],
    motions: tuple[SlidingMotion, ...],
    motor_constant: float,
) -> tuple[SKResult | None, float]:
    """The FRF fit of the quietest open-loop recording that has one worth believing, and the root mean square force that
    it was shaken with; None and zero when there is none."""
    results = []
    for recording, motion in zip(recordings, motions, strict=True):
        if recording.loop != "open" or recording.x.size < 4096:
            continue
        segment = 4096 if recording.x.size >= 16384 else 1024
        frf = estimate_frf(recording.u, recording.x, recording.sample_rate, segment=segment)
        bottom, top = _BOTTOM, min(300.0, 0.2 * recording.sample_rate)
        inside = (np.asarray(frf.frequency) > bottom) & (np.asarray(frf.frequency) < top)
        # Broadband means that most lines of the band are coherent, not that a sine is.
        if np.mean(np.asarray(frf.coherence)[inside] > 0.6) < 0.25:
            continue
        sk = fit_sk(frf, band=(bottom, top), motor_constant=motor_constant, fit_delay=True)
        positive = sk.J.value > 0 and sk.stiffness.value > 0 and sk.damping.value > 0
        if not positive or sk.stiffness.stderr > 0.2 * sk.stiffness.value:
            continue
        # A stiffness that inertia outweighs in all of the band is that of a machine that slides.
        if sk.stiffness.value < sk.J.value * (2.0 * np.pi * _STIFF_UP_TO * bottom) ** 2:
            continue
        # In stick the machine stays within a few bristle deflections; in sliding "stiffness" is a fiction.
        deflection = np.max(np.abs(motion.force)) / sk.stiffness.value
        wander = _wander(recording.x, segment)
        if wander > 3.0 * deflection:
            continue
        results.append((wander, sk, float(np.sqrt(np.mean(recording.u**2))) * motor_constant))
    return min(results, key=lambda one: one[0])[1:] if results else (None, 0.0)


def _from_rest(recording: Recording) -> float:
    """How far the machine gets from rest within one sample, position units: its acceleration over the rate squared.

    A bristle that yields on a shorter way is not in the recording, and a model of it would be chaotic.
    """
    squares = float(np.mean(np.diff(recording.x, 2) ** 2)) - 6.0 * noise_level(recording) ** 2
    return float(np.sqrt(max(squares, 0.0)))


def _wander(x: Float[np.ndarray, " n"], segment: int) -> float:
    """Standard deviation of `x` within segments: a slow drift of the resting point is no sliding."""
    whole = x[: x.size // segment * segment].reshape(-1, segment)
    return float(np.sqrt(np.mean(np.var(whole, axis=1))))


def _break_away(motions: tuple[SlidingMotion, ...], J: float, Fc: float, sliding: SlidingFit) -> float:
    """Highest smoothed force on the friction at low speed, kept between 1.05 and 2.5 times Coulomb friction."""
    peaks = []
    for motion in motions:
        slow = np.abs(motion.v) < 0.02 * sliding.top_speed
        if np.any(slow):
            peaks.append(float(np.quantile(np.abs(motion.force - J * motion.a)[slow], 0.995)))
    return float(np.clip(max(peaks, default=1.2 * Fc), 1.05 * Fc, 2.5 * Fc))
