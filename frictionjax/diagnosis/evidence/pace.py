"""The observer's pace: how much slower than usual each recording is observed, so that a coarse sensor shows the model.

A fast observer sees the sensor's noise and little of the model's errors: of a force error d it shows
d / (J (2 pi bandwidth)^2). A slow one lets an unmeasured force accumulate, and, where friction falls with velocity and
the motion is unstable, the sensor's noise as well. Between the two is the bandwidth at which the innovations of a true
model are smallest: that of the Kalman filter, found by simulation, because the machine is no free mass.
"""

import dataclasses

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch, Batch
from frictionjax.estimation.evidence import AbstractRecordings, Observed, Schedule, filtered_in_pieces
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive
from frictionjax.simulation import ObserverGains

_LEAST_BANDWIDTH = (
    5.0  # Hz: what is older than a block must be forgotten, and the start before anything is scored
)
_DRAWS = 2
_SMALLEST = 1e-300  # of a power: its logarithm is a number


def pace_of(
    drive: Drive, batch: AbstractBatch, held_out: Bool[np.ndarray, " r"], *, rule: Rule = Rule()
) -> Float[np.ndarray, " r"]:
    """Bandwidth of the observer of each recording of `batch` over the usual one, at most 1.

    Of halves of the usual bandwidth, down to that of a free mass (`free_mass_bandwidth`), the one at which the
    innovations of `drive` answer least, in the mean of the logarithms over blocks, to noise of the sensor and to the
    largest unmeasured force that the `rule` does not take for physics.

    **Arguments:**

    - `drive`: starting values.
    - `batch`: the recordings; `held_out` (bool, shape `(r,)`).
    - `rule`: `floor.largest_force`.
    """
    ones = np.ones(batch.x.shape[0])
    if not isinstance(batch, Batch):
        return ones
    optimum = np.clip(free_mass_bandwidth(drive, batch, rule), _LEAST_BANDWIDTH, SLOW_BANDWIDTH)
    # Halves of the usual bandwidth: where the optimum is nearly usual nothing changes.
    tried = [2.0 ** np.ceil(np.log2(optimum / SLOW_BANDWIDTH))]
    while np.any(tried[-1] < 1.0):
        tried.append(np.minimum(2.0 * tried[-1], 1.0))
    if len(tried) == 1:
        return ones
    tried.reverse()  # of those at which nothing is finite the fastest
    answers = [_answer(drive, batch, held_out, pace, rule) for pace in tried]
    return np.array(tried)[np.argmin(answers, axis=0), np.arange(ones.size)]


def free_mass_bandwidth(drive: Drive, batch: Batch, rule: Rule) -> Float[np.ndarray, " r"]:
    """Bandwidth, Hz, of the Kalman filter of each recording of `batch` for a free mass.

    Of a mass J whose position has the noise s and on which an unmeasured force of standard deviation f acts, new in
    each sample: sqrt(f / (J s)) / (2 pi), whatever the sample rate (Kalata, The tracking index, IEEE Trans. AES 20(2),
    1984, for slow filters). The inertia is that of `drive`, and f the largest force that the `rule` admits.
    """
    force = rule.floor.largest_force * float(drive.friction.Fc)
    return np.sqrt(force / (float(drive.J) * np.asarray(batch.noise))) / (2.0 * np.pi)


def _answer(
    drive: Drive, batch: Batch, held_out: Bool[np.ndarray, " r"], pace: Float[np.ndarray, " r"], rule: Rule
) -> Float[np.ndarray, " r"]:
    """Mean logarithm over the blocks of each recording of the squared innovations, position units squared, with which
    `drive` at this `pace` answers to noise and to an unmeasured force."""
    scales = plant_scales(drive, batch)
    posterior, vector = robust_posterior(drive, batch, held_out, scales=scales, pace=pace)
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    plain, rng = slow.errors_at([vector])[0], np.random.default_rng(20020304)
    force = rule.floor.largest_force * float(drive.friction.Fc) / float(drive.motor_constant)
    powers = []
    for _ in range(_DRAWS):
        pushed = slow.recordings.with_input(force * rng.standard_normal(batch.x.shape))
        other = with_evidence(slow, pushed.with_noise(rng.standard_normal(batch.x.shape)))
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverges has no finite answer
            powers.append(batch.block_mean((other.errors_at([vector])[0] - plain) ** 2))
    recordings = slow.recordings
    assert isinstance(recordings, Observed)
    unit = np.asarray(batch.noise)[:, None] * np.asarray(recordings.unit)[:, :1]
    power = np.mean(powers, axis=0) * unit**2
    scored = np.asarray(batch.block_count) > 0
    logs = np.where(scored, np.log(np.maximum(np.nan_to_num(power, nan=np.inf), _SMALLEST)), 0.0)
    return np.sum(logs, axis=1) / np.maximum(np.sum(scored, axis=1), 1)


def schedule_of(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    pace: Float[Numbers, " r"],
    *,
    rule: Rule = Rule(),
) -> Schedule | None:
    """The gains of a Kalman filter for the recordings whose `pace` is slow: for the machine of the `posterior` at the
    `vector`, the noise of the sensor, and the largest unmeasured force that the `rule` does not take for physics. None
    where there are no such recordings.

    Where friction falls with velocity noise grows in the motion, and the filter corrects more; in stick the bristles
    hold the machine, and it corrects less. Constant gains are too slow for the one, or so fast that they hide what acts
    longer than a tenth of a second. The filter recovers where the machine, from which something is missing, loses it.

    Near break-away the filter takes the machine for sliding or for stuck by the sign of each estimated velocity, and
    its gains jump with the noise that they weigh. The observer, which corrects no slipping bristle, would drift away:
    what is weighed more when it points forward adds up. It takes the means of the gains over twice its memory.
    """
    batch, drive, slow = posterior.batch, posterior.drive_of(vector), np.asarray(pace) < 1.0
    if not isinstance(batch, Batch) or not np.any(slow):
        return None
    noise = np.asarray(batch.noise)
    ratio = rule.floor.largest_force * float(drive.friction.Fc) / noise[:, None]
    z0 = np.asarray(vector)[posterior.parameters :]
    known = np.ones(noise.shape, dtype=bool)
    found, _ = filtered_in_pieces(drive, z0, batch, ratio, known, batch.substeps, recovers=True)
    gains, unit = np.asarray(found.gain), np.asarray(found.deviation) / noise[:, None]
    finite = np.all(np.isfinite(gains[..., :2]), axis=(1, 2)) & np.all(np.isfinite(unit), axis=1)
    bandwidth = free_mass_bandwidth(drive, batch, rule)
    memory = 1.0 / (2.0 * np.pi * np.clip(bandwidth, _LEAST_BANDWIDTH, SLOW_BANDWIDTH))
    position, velocity, unit = (_averaged(own, batch, memory) for own in (gains[..., 0], gains[..., 1], unit))
    return Schedule(
        ObserverGains(position, velocity),
        unit,
        bandwidth,
        finite & slow,
        SLOW_BANDWIDTH,
    )


def _averaged(
    values: Float[np.ndarray, "r n"], batch: Batch, memory: Float[np.ndarray, " r"]
) -> Float[np.ndarray, "r n"]:
    """The means of the `values` over twice the `memory`, s, about each sample of the recordings of the `batch`."""
    means = np.array(values)
    for row, (length, dt) in enumerate(zip(batch.lengths, np.asarray(batch.dt), strict=True)):
        width = max(round(2.0 * float(memory[row] / dt)), 1)
        means[row, :length] = scipy.ndimage.uniform_filter1d(values[row, :length], width, mode="nearest")
    return means


def at_pace(posterior: Posterior, pace: Float[Numbers, " r"], schedule: Schedule | None) -> Posterior:
    """The `posterior` with slow observers of this `pace` and `schedule`."""
    recordings = posterior.recordings
    if isinstance(recordings, Observed):
        posterior = with_evidence(posterior, dataclasses.replace(recordings, schedule=schedule))
    return posterior.at_bandwidth(SLOW_BANDWIDTH, pace=pace)


def is_coarse(posterior: Posterior) -> bool:
    """Whether a sensor of the recordings is so coarse that its observer is slower than usual."""
    recordings = posterior.recordings
    return isinstance(recordings, Observed) and bool(np.any(np.asarray(recordings.pace) < 1.0))


def search_bandwidth(posterior: Posterior, vector: Float[Numbers, " q"]) -> float:
    """Bandwidth, Hz, of the observers through which effects are searched for beside the model at the `vector`.

    That of the fast ones, which tolerate a model that is far off. Through a coarse sensor they may show its noise and
    little else: there it is that of the observers that show more of what the model misses.
    """
    if not is_coarse(posterior):
        return FAST_BANDWIDTH
    fast, slow = (
        posterior.at_bandwidth(one).misfits([vector])[0] for one in (FAST_BANDWIDTH, SLOW_BANDWIDTH)
    )
    return FAST_BANDWIDTH if fast > slow else SLOW_BANDWIDTH


def with_evidence(posterior: Posterior, evidence: AbstractRecordings) -> Posterior:
    """The `posterior` of other `evidence` of the same shape."""
    return eqx.tree_at(lambda p: p.evidence, posterior, (evidence,))
