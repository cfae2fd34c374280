"""Which lines of a multisine are excited, and which are left silent as detection lines."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from frictionjax.core import InputError


class MultisineLines(eqx.Module):
    """Lines of a periodic signal, as multiples of `sample_rate / n`.

    **Attributes:**

    - `excited`: lines that carry a sine, ascending, shape `(f,)`.
    - `odd`: odd lines between the first and the last of them that are silent, shape `(o,)`: what appears there is
        noise or an odd nonlinearity, such as friction.
    - `even`: even lines there that are silent, shape `(e,)`: noise or an even nonlinearity, such as asymmetry.
    - `spacing`: `sample_rate / n`, Hz.
    """

    excited: Int[np.ndarray, " f"]
    odd: Int[np.ndarray, " o"]
    even: Int[np.ndarray, " e"]
    spacing: float = eqx.field(static=True)

    @property
    def frequency(self) -> Float[np.ndarray, " f"]:
        """The excited lines in Hz, shape `(f,)`."""
        return self.spacing * self.excited


def silent_lines(excited: Int[np.ndarray, " f"], spacing: float) -> MultisineLines:
    """The silent lines between `excited` ones, `spacing` Hz apart."""
    excited = np.unique(np.asarray(excited, int))
    silent = np.setdiff1d(np.arange(excited[0], excited[-1] + 1), excited)
    return MultisineLines(excited, silent[silent % 2 == 1], silent[silent % 2 == 0], float(spacing))


def multisine_lines(
    key: PRNGKeyArray,
    n: int,
    sample_rate: float,
    band: tuple[float, float],
    *,
    group: int = 4,
) -> MultisineLines:
    """Odd lines of a band, less one of each group of `group`, drawn at random.

    The silent odd lines show how strong odd nonlinearities are, all even lines show even nonlinearities
    (Pintelon and Schoukens, System Identification, 2nd ed., 2012, ch. 4, who take groups of three or four). Draw once,
    and give the same lines to `multisine` for every realisation: only the phases are to differ.

    **Arguments:**

    - `key`: key of `jax.random`; not the one that draws the phases.
    - `n`: number of samples, one period.
    - `sample_rate`: samples per second, Hz.
    - `band`: lowest and highest frequency, Hz.
    - `group`: odd lines in a group, of which one stays silent; 0 for none.

    **Returns:** the `MultisineLines`, whose `frequency` goes to `multisine` as `lines_or_band`.

    **Raises:** `InputError` when the band has fewer than two groups of lines that `n` samples can carry, or
        `group` is negative or 1.
    """
    spacing = sample_rate / n
    if group < 0 or group == 1:
        raise InputError(
            f"`group` is {group} and would leave no lines", cure="Choose 3 or 4, or 0 to leave out none."
        )
    # The small margin keeps an edge that is a line itself, whatever the division rounds to.
    low, high = (edge / spacing for edge in band)
    lines = np.arange(max(1, np.ceil(low - 1e-6)), np.floor(high + 1e-6) + 1).astype(int)
    lines = lines[(lines % 2 == 1) & (2 * lines < n)]
    if lines.size < max(2 * group, 2):
        raise InputError(
            f"`band` from {band[0]} to {band[1]} Hz holds {lines.size} odd lines that {n} samples at {sample_rate} Hz "
            "can carry",
            cure=f"Widen it or take a larger `n`: lines are {spacing:.4g} Hz apart, every second is odd.",
        )
    if group:
        # An incomplete group at the end of the band keeps all its lines.
        groups = lines.size // group
        silent = group * np.arange(groups) + np.asarray(jax.random.randint(key, (groups,), 0, group))
        lines = np.delete(lines, silent)
    return silent_lines(lines, spacing)
