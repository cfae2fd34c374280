"""Small studies, whose functions other processes find by name."""

import os
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from frictionjax import Axis, CompiledTask, Factorial, PythonTask, Study, run_study


def drawn(key, gain, offset, kind="plain"):
    """A sum whose last bits depend on how it is computed; now and then not finite, or not converged."""
    noise = jax.random.normal(key, (50,))
    value = offset + gain * jnp.mean(jnp.sin(noise) * jnp.exp(0.1 * noise))
    if kind == "squared":
        value = value**2
    return {
        "value": jnp.where(noise[0] > 2.0, jnp.nan, value),
        "value_stderr": gain / 7.0,
        "history": noise[:3],
        "converged": noise[1] > -2.0,
        "large": value > offset,
    }


def compiled_study(repeats=40, seed=5, lanes=8, **task):
    """Cases of `drawn`: two axes of numbers and one of texts."""
    axes = (
        Axis("gain", [1.0, 2.0, 4.0], unit="N"),
        Axis("kind", ["plain", "squared"]),
        Axis("offset", low=0.1, high=10.0, scale="log", count=2, unit="m"),
    )
    units = {"value": "N", "value_stderr": "N"}
    return Study(
        Factorial(*axes, repeats=repeats),
        CompiledTask(drawn, units=units, dims={"history": ("step",)}, lanes=lanes, **task),
        seed=seed,
    )


def plain(rng, gain):
    """A number, a text, a boolean and an array; some cases raise."""
    draw = rng.normal()
    if draw > 1.2:
        raise ZeroDivisionError(f"no result at {gain}")
    return {"value": gain * draw, "word": f"w{round(draw)}", "positive": draw > 0, "pair": [draw, 2.0]}


def plain_study(repeats=10, seed=0, function=plain, gains=(1.0, 2.0)):
    """Cases of a Python function."""
    return Study(Factorial(Axis("gain", gains), repeats=repeats), PythonTask(function), seed=seed)


def noted(rng, number):
    """Note in the file of the environment that this case is computed, and take a moment."""
    with Path(os.environ["FRICTIONJAX_TEST_NOTES"]).open("a", encoding="ascii") as notes:
        notes.write(f"{number}\n")
    time.sleep(float(os.environ.get("FRICTIONJAX_TEST_PAUSE", "0")))
    return {"value": number + rng.normal(), "word": str(number)}


def noted_study(cases=60):
    """Cases of `noted`."""
    return Study(Factorial(Axis("number", range(cases))), PythonTask(noted), seed=9)


def same(one, other):
    """Assert that two data sets are the same bit by bit."""
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        first, second = one[name].values, other[name].values
        assert one[name].dims == other[name].dims
        assert first.shape == second.shape
        if first.dtype.kind in "fib":
            assert first.dtype == second.dtype and first.tobytes() == second.tobytes(), name
        else:
            assert [str(a) for a in first.ravel()] == [str(b) for b in second.ravel()], name
        assert dict(one[name].attrs) == dict(other[name].attrs)


def scaled(key, gain):
    """Noise of this gain."""
    return {"value": gain * jax.random.normal(key)}


def run_scaled(k):
    """A call that runs a study of `scaled`; another `k`: other values, more of them, and another seed."""
    pytest.importorskip("zarr")
    design = Factorial(Axis("gain", [1.0 + k, *range(3, 5 + k)]), repeats=3 + k)
    study = Study(design, CompiledTask(scaled, lanes=4), seed=k)
    return lambda: run_study(study, devices=jax.local_devices()[:1], progress=False)["value"].values


def kept_study(folder):
    """The store of a finished study of a Python function."""
    pytest.importorskip("zarr")
    run_study(plain_study(repeats=2), folder / "study.zarr", progress=False)
    return folder / "study.zarr"
