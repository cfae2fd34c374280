"""Require float64; it is never switched on without the user's consent."""

import jax

from frictionjax.core.errors import PrecisionError
from frictionjax.core.forks import require_own_threads


def require_x64() -> None:
    """Raise `PrecisionError` unless JAX computes in float64; and `RuntimeError` where it cannot compute at all.

    A bristle deflection of 1 nm on a stroke of 10 mm is one part in 1e7: below the resolution of float32.
    """
    require_own_threads()
    if not jax.config.read("jax_enable_x64"):
        raise PrecisionError(
            "frictionjax computes in float64 and JAX is set to float32. "
            "Call `frictionjax.configure_jax()` once, before any other use of JAX "
            '(or `jax.config.update("jax_enable_x64", True)`), '
            "or set the environment variable JAX_ENABLE_X64=1."
        )
