"""The stiffness from frequency responses falls as the level of the excitation grows: the paper's Table III."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Key, Real

from frictionjax.core import InputError, Progress, public_verb, reporting, require_x64
from frictionjax.core.display import AbstractDisplayed, Display, records_grid
from frictionjax.core.frames import records, to_dataframe
from frictionjax.excitation import gaussian_noise, prbs
from frictionjax.excitation.prbs import HALF_POWER
from frictionjax.frequency import FRF, estimate_frf
from frictionjax.frequency.extrapolation import ZeroAmplitude, extrapolate_to_zero_amplitude
from frictionjax.frequency.second_order import Lines, start
from frictionjax.physics import Drive, LuGre, linearize
from frictionjax.simulation import simulate

LEVELS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.26, 0.35, 0.45, 0.6)
"""Levels of the excitation, rms over break-away; 0.26 is the smallest of the paper, if its 0.01 V are rms."""

EXCITATIONS = ("prbs", "gaussian")
CHUNK = (
    60  # records simulated at a time: 20 s at 10 kHz of each are 100 MB, and as much again for their segments
)


def table_one() -> Drive:
    """The machine of the paper's Table I: a unit mass on a LuGre contact, in N, m and s."""
    return Drive(J=1.0, friction=LuGre(sigma0=1e5, sigma1=1e5**0.5, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3))


class LevelSweep(AbstractDisplayed):
    """Readings from frequency responses at each level of the excitation, all else equal.

    Arrays over excitations, levels and seeds have the shape `(2, k, seeds)`, in the order of `excitations`.

    **Attributes:**

    - `levels`: rms of the excitation over the break-away force, shape `(k,)`.
    - `excitations`: their names.
    - `stiffness`: fitted on `band`, force per position unit.
    - `low_frequency_stiffness`: mean of `1 / |H|` on `low_band`, force per position unit.
    - `damping`, `inertia`: fitted on `band`, in force s and force s^2 per position unit.
    - `coherence`: its mean on `low_band`.
    - `true_stiffness`: stiffness of the machine at rest, force per position unit: the limit at zero amplitude.
    - `band`, `low_band`: frequencies, Hz.
    """

    levels: Float[np.ndarray, " k"]
    excitations: tuple[str, ...] = eqx.field(static=True)
    stiffness: Float[np.ndarray, "2 k seeds"]
    low_frequency_stiffness: Float[np.ndarray, "2 k seeds"]
    damping: Float[np.ndarray, "2 k seeds"]
    inertia: Float[np.ndarray, "2 k seeds"]
    coherence: Float[np.ndarray, "2 k seeds"]
    true_stiffness: float = eqx.field(static=True)
    band: tuple[float | int, float | int] = eqx.field(static=True)
    low_band: tuple[float | int, float | int] = eqx.field(static=True)

    def _display(self) -> Display:
        return Display(f"Level sweep of {self.levels.size} levels", (), (records_grid(self.table()),))

    def plot(self, **how: Any) -> Any:
        """Draw the stiffness over the level of the excitation: `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the rows of `table`."""
        return to_dataframe(records(self.table()))

    def mean(self, kind: str, quantity: str = "stiffness") -> Float[np.ndarray, " k"]:
        """Mean over the seeds, shape `(k,)`, of the attribute `quantity` with the excitation `kind`."""
        return np.mean(getattr(self, quantity)[self._place(kind)], axis=1)

    def std(self, kind: str, quantity: str = "stiffness") -> Float[np.ndarray, " k"]:
        """Standard deviation over the seeds, shape `(k,)`, of the attribute `quantity` with the excitation `kind`."""
        return np.std(getattr(self, quantity)[self._place(kind)], axis=1, ddof=1)

    def zero_amplitude(
        self, kind: str, *, upto: float | int | None = None, seed: int | None = None
    ) -> ZeroAmplitude:
        """Stiffness extrapolated to zero amplitude.

        **Arguments:**

        - `kind`: the excitation.
        - `upto`: highest level that is used; all levels by default.
        - `seed`: the records of this seed alone, as in one experiment at each level; by default the means over all.

        **Raises:** `InputError` when fewer than three levels are left.
        """
        use = self.levels <= (np.inf if upto is None else upto * (1.0 + 1e-9))
        if use.sum() < 3:
            raise InputError(
                f"{use.sum()} of the levels lie below {upto}", cure="Leave three or more for the curve."
            )
        spread, count = self.std(kind), self.stiffness.shape[2]
        value = self.mean(kind) if seed is None else self.stiffness[self._place(kind), :, seed]
        stderr = spread / np.sqrt(count) if seed is None else spread
        return extrapolate_to_zero_amplitude(self.levels[use], value[use], stderr[use])

    def table(self) -> list[dict[str, Any]]:
        """One row for each excitation and level: means and standard deviations over the seeds."""
        return [
            {
                "excitation": kind,
                "level": float(level),
                "stiffness": float(self.mean(kind)[i]),
                "stiffness_std": float(self.std(kind)[i]),
                "low_frequency_stiffness": float(self.mean(kind, "low_frequency_stiffness")[i]),
                "low_frequency_stiffness_std": float(self.std(kind, "low_frequency_stiffness")[i]),
                "coherence": float(self.mean(kind, "coherence")[i]),
                "true_stiffness": self.true_stiffness,
            }
            for kind in self.excitations
            for i, level in enumerate(self.levels)
        ]

    def _place(self, kind: str) -> int:
        if kind not in self.excitations:
            raise InputError(
                f"there is no excitation {kind!r}", cure=f"Choose one of {', '.join(self.excitations)}."
            )
        return self.excitations.index(kind)


class Setting(NamedTuple):
    """How each record is made and analysed: see `level_sweep`."""

    n: int
    segment: int
    sample_rate: float | int
    bandwidth: float | int
    band: tuple[float | int, float | int]
    low_band: tuple[float | int, float | int]


def level_sweep(
    drive: Drive | None = None,
    *,
    levels: Real[ArrayLike, " k"] | Sequence[float | int] | None = None,
    seeds: int = 20,
    averages: int = 50,
    sample_rate: float | int = 10_000.0,
    segment: int = 8192,
    bandwidth: float | int = 500.0,
    band: tuple[float | int, float | int] = (3.0, 150.0),
    low_band: tuple[float | int, float | int] = (3.0, 8.0),
    seed: int = 0,
    progress: Progress | bool = True,
) -> LevelSweep:
    """Simulate noise experiments at every level and seed, and read the stiffness from each frequency response.

    All records are one batch: it is simulated, transformed and fitted by one `jax.vmap`, some records at a time. The
    frequency responses are the paper's (Hann, 50 % overlap); the position carries no noise, so what lowers coherence
    and stiffness is friction alone. `1 / H = stiffness + damping s + J s^2` is fitted by linear least squares with
    relative errors, and the half-sample delay of the zero-order hold is removed.

    **Arguments:**

    - `drive`: the `Drive`; by default that of Table I.
    - `levels`: rms over break-away, `Fs / motor_constant`, shape `(k,)`; by default twelve from 0.01 to 0.6.
    - `seeds`: independent records at each level and excitation, at least two.
    - `averages`: segments in an average, 50 % overlapped.
    - `sample_rate`: Hz; the scheme of `simulate` makes one step a sample.
    - `segment`: samples in a segment.
    - `bandwidth`: upper end of the noise, Hz.
    - `band`: where the second-order system is fitted, Hz.
    - `low_band`: where the stiffness is read from `1 / |H|`, Hz.
    - `seed`: of the random numbers.
    - `progress`: called after each part of the batch; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:** the `LevelSweep`.

    **Raises:** `InputError` when `levels` are not positive, `seeds` or `averages` are below two, or a band contains no
        bins; `PrecisionError` when JAX computes in float32.
    """
    require_x64()
    drive = table_one() if drive is None else drive
    levels = np.atleast_1d(np.asarray(LEVELS if levels is None else levels, float))
    _check(levels, seeds, averages, sample_rate / segment, band, low_band)
    n = segment + (averages - 1) * (segment - segment // 2)
    setting = Setting(n, segment, sample_rate, bandwidth, band, low_band)

    shape = (len(EXCITATIONS), levels.size, seeds)
    binary = np.broadcast_to(np.array([True, False])[:, None, None], shape).ravel()
    level = np.broadcast_to(levels[None, :, None], shape).ravel()
    keys = jax.random.split(jax.random.key(seed), level.size)
    # Equal parts, so that one compiled program serves them all; the last is filled up with records that are dropped.
    parts = -(-level.size // CHUNK)
    width = -(-level.size // parts)
    found = []
    with reporting(progress) as report:
        for part in range(parts):
            place = np.minimum(np.arange(part * width, (part + 1) * width), level.size - 1)
            found.append(
                _records(drive, keys[place], jnp.asarray(level[place]), jnp.asarray(binary[place]), setting)
            )
            jax.block_until_ready(found[-1])
            report("levels", (part + 1) / parts)
    numbers = np.concatenate(found, axis=1)[:, : level.size].reshape(5, *shape)
    return LevelSweep(
        levels=levels,
        excitations=EXCITATIONS,
        stiffness=numbers[0],
        damping=numbers[1],
        inertia=numbers[2],
        low_frequency_stiffness=numbers[3],
        coherence=numbers[4],
        true_stiffness=float(linearize(drive).stiffness),
        band=band,
        low_band=low_band,
    )


def _check(
    levels: Float[np.ndarray, "..."],
    seeds: int,
    averages: int,
    resolution: float,
    band: tuple[float | int, float | int],
    low_band: tuple[float | int, float | int],
) -> None:
    if levels.ndim != 1 or not np.all(levels > 0.0):
        raise InputError("`levels` must be positive", cure="Give rms over break-away, such as 0.01 to 0.6.")
    if seeds < 2 or averages < 2:
        raise InputError(
            f"`seeds` is {seeds} and `averages` is {averages}",
            cure="Give two or more of each: one record has no spread.",
        )
    for name, (low, high), bins in (("band", band, 4), ("low_band", low_band, 1)):
        inside = np.floor(high / resolution) - np.ceil(low / resolution) + 1
        if inside < bins:
            raise InputError(
                f"`{name}` from {low} to {high} Hz contains {inside:.0f} bins",
                cure="Widen it, or take a longer `segment`.",
            )


@eqx.filter_jit
def _records(
    drive: Drive,
    keys: Key[Array, " lanes"],
    levels: Float[Array, " lanes"],
    binary: Bool[Array, " lanes"],
    setting: Setting,
) -> Float[Array, "5 lanes"]:
    """Stiffness, damping, inertia, low-frequency stiffness and coherence of each record, shape `(5, lanes)`."""

    def record(
        key: Key[Array, ""], level: Float[Array, ""], is_binary: Bool[Array, ""]
    ) -> Float[Array, " 5"]:
        u = noise(key, level * drive.friction.Fs / drive.motor_constant, is_binary, setting)
        x = simulate(drive, u, setting.sample_rate, substeps=1).x
        frf = estimate_frf(drive.motor_constant * u, x, setting.sample_rate, segment=setting.segment)
        return readings(frf, setting)

    return jax.vmap(record)(keys, levels, binary).T


def noise(
    key: Key[Array, ""], rms: Float[Array, ""], is_binary: Bool[Array, ""], setting: Setting
) -> Float[Array, " n"]:
    """Noise of the given `rms` with nothing above the bandwidth of `setting`, shape `(n,)`, from the `key`.

    Gaussian, or, where `is_binary`, binary with a clock of twice the bandwidth, behind a sharp low-pass. Both then
    have about the same power at low frequencies.
    """
    n, rate, bandwidth = setting.n, setting.sample_rate, setting.bandwidth
    ticks = prbs(key, n, rate, min(2.0 * HALF_POWER * bandwidth * (1.0 - 1e-9), rate / 2.0), 1.0)
    kept = jnp.arange(n // 2 + 1) <= int(bandwidth * n // rate)
    smooth = jnp.fft.irfft(jnp.where(kept, jnp.fft.rfft(ticks), 0.0), n)
    smooth = smooth / jnp.sqrt(jnp.mean(smooth**2))
    return rms * jnp.where(is_binary, smooth, gaussian_noise(key, n, rate, bandwidth, 1.0))


def readings(frf: FRF, setting: Setting) -> Float[Array, " 5"]:
    """Stiffness, damping, inertia, low-frequency stiffness and coherence of one frequency response, shape `(5,)`.

    `frf` goes from force to position; `setting` has the bands.
    """
    frequency = np.arange(setting.segment // 2 + 1) * (setting.sample_rate / setting.segment)

    def bins(band: tuple[float | int, float | int]) -> Int[np.ndarray, " bins"]:
        return np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))

    fitted, low = bins(setting.band), bins(setting.low_band)
    unit = 2.0 * np.pi * frequency[fitted[-1]]
    response = frf.response[fitted]
    size = jnp.abs(response)
    scale = jnp.max(size)
    # `start` weighs D - 1 / H with weight |H|^2: with one over |H|, errors are relative to 1 / H.
    lines = Lines(
        jnp.asarray(2.0 * np.pi * frequency[fitted] / unit),
        response / jax.lax.complex(scale, jnp.zeros_like(scale)),
        scale / jnp.maximum(size, 1e-9 * scale),
        jnp.asarray(2.0 * np.pi * setting.sample_rate / unit),
    )
    a = start(lines, jnp.zeros(()), True)[:3] / (scale * jnp.asarray(unit ** np.arange(3.0)))
    stiffness = jnp.mean(1.0 / jnp.abs(frf.response[low]))
    return jnp.concatenate([a, jnp.stack([stiffness, jnp.mean(frf.coherence[low])])])
