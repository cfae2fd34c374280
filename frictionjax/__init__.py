"""frictionjax: locate the mismatch between a machine and its model, name the missing physics, verify it.

The public names are listed in `frictionjax.api`. They are loaded on first use, so that `frictionjax --help`
does not wait for JAX.
"""

import importlib
from importlib.metadata import version as _version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frictionjax.api import *  # noqa: F403

__version__ = _version("frictionjax")


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(name)
    if name == "configure_jax":
        # Before the rest is loaded: with some versions of its libraries that alone makes JAX compute something.
        return importlib.import_module("frictionjax.core").configure_jax
    api = importlib.import_module("frictionjax.api")
    if name not in api.__all__:
        raise AttributeError(
            f"frictionjax has no public name `{name}`. Public names: {', '.join(api.__all__)}."
        )
    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted(importlib.import_module("frictionjax.api").__all__)
