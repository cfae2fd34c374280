"""`FitResult`: estimates, their uncertainty and the noise of a fit."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate, public_verb
from frictionjax.core.arrays import Numbers
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid, estimates_grid
from frictionjax.core.frames import estimate_columns, to_dataframe, to_xarray
from frictionjax.estimation.descent.refine import Refined
from frictionjax.estimation.descent.stepper import Ending
from frictionjax.estimation.evidence import Forces, Positions
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.uncertainty import estimates, uncertainty_at
from frictionjax.physics import Drive

_IMPROVING = "The fit stopped at its last round while still improving; start it again from its own result."
_STOPPED = {Ending.AT_REST: _IMPROVING, Ending.STEPS: _IMPROVING}


class RecordingNoise(eqx.Module):
    """The noise of one recording.

    **Attributes:**

    - `position`: standard deviation of the measured position, position units; of the measured force, force units, for
      `drive = "motion"`.
    - `push`: standard deviation of the unmeasured force (all that acts on the machine and is neither the input nor in
        the model), constant over each sample, force units.
    - `power`: mean square of the standardised innovations: 1 where model and noise explain all.
    """

    position: float = eqx.field(static=True)
    push: float = eqx.field(static=True)
    power: float = eqx.field(static=True)


class FitResult(AbstractDisplayed):
    """A fitted drive.

    **Attributes:**

    - `drive`: the fitted `Drive`.
    - `parameters`: label -> `Estimate` in physical units, tied parameters included.
    - `names`: labels of the p free parameters, in the order of `covariance`.
    - `covariance`: of the free parameters in physical units, shape `(p, p)`: inverse information, with standard
      deviations raised where clusters of correlated errors say more (`uncertainty.clustered_covariance`).
    - `covariance_white`: inverse information alone, right when the errors are white, shape `(p, p)`.
    - `noise`: name of the recording -> `RecordingNoise`.
    - `cost`: minus the log-posterior, noise included, but for a constant: for comparing fits of the same data.
    - `success`, `message`: whether the fit converged; why it stopped, which parameters are at an end of their range,
        and which cannot be identified from these data.
    - `at_bounds`: labels of parameters at an end of their range.
    - `posterior`, `vector`: for those who go on from here; None in a result that was read from a file.
    """

    drive: Drive
    parameters: dict[str, Estimate] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    covariance: Float[np.ndarray, "p p"]
    covariance_white: Float[np.ndarray, "p p"]
    noise: dict[str, RecordingNoise] = eqx.field(static=True)
    cost: float = eqx.field(static=True)
    success: bool = eqx.field(static=True)
    message: str = eqx.field(static=True)
    at_bounds: tuple[str, ...] = eqx.field(static=True)
    posterior: Posterior | None = None
    vector: Float[Numbers, " q"] | None = None

    @property
    def stderr(self) -> dict[str, float]:
        """Label -> standard error in physical units."""
        return {name: estimate.stderr for name, estimate in self.parameters.items()}

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation of the free parameters, shape `(p, p)`; NaN where a variance is not finite."""
        spread = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.covariance / spread[:, None] / spread[None, :]

    def _display(self) -> Display:
        noise = tuple(
            (name, f"{one.position:.3g}", f"{one.push:.3g}", f"{one.power:.3g}")
            for name, one in self.noise.items()
        )
        head = ("recording", "sensor noise", "unmeasured force", "innovation power")
        effects = [effect.name for effect in self.drive.effects]
        title = f"Fit of LuGre {'with ' + ', '.join(effects) if effects else 'alone'}"
        return Display(title, (self.message,), (estimates_grid(self.parameters), TextGrid(head, noise)))

    def plot(self, **how: Any) -> Any:
        """Draw friction against velocity, the presliding loop and the correlations of the estimates:
        `frictionjax.plot`, with `how` as there."""
        return public_verb("plot")(self, **how)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each parameter: `value`, `stderr`, `unit`, `identified`."""
        return to_dataframe(estimate_columns(self.parameters), index="parameter")

    def to_xarray(self) -> Any:
        """An xarray Dataset over `parameter`: `value`, `stderr`, and `covariance` over `parameter` and `other`."""
        own = [self.parameters[name] for name in self.names]
        arrays = {
            "value": (("parameter",), np.array([one.value for one in own])),
            "stderr": (("parameter",), np.array([one.stderr for one in own])),
            "unit": (("parameter",), np.array([one.unit for one in own])),
            "covariance": (("parameter", "other"), self.covariance),
        }
        return to_xarray(
            arrays, {"parameter": list(self.names), "other": list(self.names)}, message=self.message
        )


def make_result(
    refined: Refined, names: tuple[tuple[str, ...], ...], units: Mapping[str, str], extra: tuple[str, ...]
) -> FitResult:
    """The `FitResult` of a `refined` fit; `names` of the recordings of each evidence, `units` by kind, and `extra`
    sentences for the message."""
    posterior, vector = refined.posterior, refined.vector
    layout, count = posterior.layout, posterior.parameters
    evaluations = posterior.evaluated(vector)
    near = posterior.assembled(evaluations, vector)
    known = uncertainty_at(posterior, vector, evaluations, near)
    parameters, errors = estimates(posterior, known, units), known.errors
    finite = bool(np.all(np.isfinite(errors.covariance)))
    at_end = {one.label for one, end in zip(layout, known.at_end, strict=True) if end}
    unidentified = [
        one.label for one in layout if not parameters[one.label].identified and one.label not in at_end
    ]
    sentences = [
        "The fit converged: neither noise nor parameters move any more."
        if refined.converged
        else _STOPPED.get(refined.ending, refined.ending.value)
    ]
    if at_end:
        sentences.append(f"At the end of its range: {', '.join(sorted(at_end))}.")
    if unidentified:
        sentences.append(
            f"Not identifiable from these data: {', '.join(unidentified)}. "
            "`identifiability(result)` lists experiments that would determine them."
        )
    if not finite:
        sentences.append("Derivatives overflow at the solution, so no standard errors can be computed.")
    return FitResult(
        drive=posterior.drive_of(vector),
        parameters=parameters,
        names=tuple(one.label for one in layout),
        covariance=errors.covariance[:count, :count],
        covariance_white=errors.white[:count, :count],
        noise=_noise_of(refined, near.powers, names),
        cost=refined.cost,
        success=refined.converged and finite,
        message=" ".join((*sentences, *extra)),
        at_bounds=tuple(sorted(at_end)),
        posterior=posterior,
        vector=vector,
    )


def _noise_of(
    refined: Refined, powers: tuple[Float[Numbers, "_ _"], ...], names: tuple[tuple[str, ...], ...]
) -> dict[str, RecordingNoise]:
    found = {}
    for evidence, blocks, own in zip(refined.posterior.evidence, powers, names, strict=True):
        count = np.asarray(evidence.count).reshape(len(own), -1)
        power = (np.asarray(blocks).reshape(len(own), -1) * count).sum(1) / count.sum(1)
        for row, name in enumerate(own):
            if isinstance(evidence, Positions) and refined.noise is not None:
                level, push = (
                    float(np.asarray(n)[row]) for n in (refined.noise.position, refined.noise.push)
                )
            elif isinstance(evidence, Forces):
                level, push = float(np.asarray(evidence.noise)[row]), 0.0
            else:
                level, push = float("nan"), 0.0
            found[name] = RecordingNoise(level, push, float(power[row]))
    return found
