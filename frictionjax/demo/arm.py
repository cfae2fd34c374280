"""The arm of the demo: its true parameters, which are not part of the case."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Arm:
    """A rotating arm with friction, of the kind of the paper's Fig. 3. Every number is this project's choice.

    The friction torque is the sum of three parts. `share` of it comes from `elements` parallel Maxwell-slip
    elements, each a spring of stiffness `share * sigma0 / elements` in series with a dry contact that yields at
    its own limit; the rest, `1 - share`, comes from one bristle of the LuGre kind; and `sigma2 * v` is viscous.
    All limits follow one Stribeck curve, `s(v) = Fc + (Fs - Fc) exp(-(v / vs)^2)`, so that the whole slides at
    `s(v) sgn(v) + sigma2 v` and sticks with stiffness `sigma0`, whatever `share` is.

    **Attributes:**

    - `motor_constant`: torque per volt, N*m/V.
    - `J`: inertia, kg*m^2.
    - `sigma0`: stiffness at rest, N*m/rad.
    - `sigma1`: damping of the elastic deflection, N*m*s/rad.
    - `sigma2`: viscous friction, N*m*s/rad.
    - `Fc`, `Fs`: Coulomb and static friction torque, N*m.
    - `vs`: Stribeck velocity, rad/s.
    - `share`: part of the friction that the elements carry; 0 leaves the single bristle.
    - `elements`: how many Maxwell-slip elements there are.
    - `spread`: largest over smallest deflection at which an element yields.
    - `encoder_step`: quantum of the measured position, rad.
    - `noise`: standard deviation of the sensor's noise before quantisation, in encoder steps.
    """

    motor_constant: float = 16.0
    J: float = 0.03
    sigma0: float = 2000.0
    sigma1: float = 4.0
    sigma2: float = 0.05
    Fc: float = 0.5
    Fs: float = 0.65
    vs: float = 0.05
    share: float = 0.8
    elements: int = 10
    spread: float = 100.0
    encoder_step: float = 1.2e-6
    noise: float = 0.4

    @property
    def yield_shares(self) -> Float[np.ndarray, " elements"]:
        """Part of `s(v)` at which each element yields, shape `(elements,)`; their sum is `share`.

        The limits are spaced evenly in the logarithm. A single bristle behaves under a first load like elements
        with exponentially distributed limits; a tail longer than that lets this arm move further at large torque
        and return stiffer, as the paper's arm did in its Fig. 5 and 6(b).
        """
        limits = np.geomspace(1.0, self.spread, self.elements)
        return self.share * limits / limits.sum()


def draw_arm(rng: np.random.Generator, *, base: bool = False) -> Arm:
    """An arm whose numbers lie within about ten per cent of the nominal ones.

    **Arguments:**

    - `rng`: source of the draws.
    - `base`: whether friction is the single bristle alone, so that nothing is missing from a LuGre model.

    **Returns:** the `Arm`.
    """
    nominal = Arm()
    names = ("J", "sigma0", "sigma1", "sigma2", "Fc", "vs")
    drawn = {name: getattr(nominal, name) * float(np.exp(rng.uniform(-0.1, 0.1))) for name in names}
    # Fs is drawn as a ratio, so that it always stays above Fc.
    Fs = drawn["Fc"] * (1.0 + (nominal.Fs / nominal.Fc - 1.0) * float(np.exp(rng.uniform(-0.1, 0.1))))
    return Arm(**drawn, Fs=Fs, share=0.0 if base else nominal.share)
