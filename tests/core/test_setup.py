"""`configure_jax`: what it sets, what it leaves alone, and that it comes in time or says so."""

import os
import subprocess
import sys

import pytest

import frictionjax
from frictionjax.core import setup
from frictionjax.core.setup import _with_our_flags


def _run(code, **variables):
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=600,
        env=environment | variables,
        check=False,
    )


def test_float64_and_a_device_for_every_core():
    code = (
        "import frictionjax, jax, os; frictionjax.configure_jax(); "
        "print(jax.numpy.ones(1).dtype, len(jax.devices('cpu')) == len(os.sched_getaffinity(0)))"
    )
    done = _run(code)
    assert done.stdout.split() == ["float64", "True"], done.stderr


def test_the_number_of_devices_is_the_callers():
    code = "import frictionjax, jax; frictionjax.configure_jax(cpu_devices=3); print(len(jax.devices('cpu')))"
    assert _run(code).stdout.split() == ["3"]


def test_a_number_of_devices_in_the_environment_stays():
    code = "import frictionjax, jax; frictionjax.configure_jax(); print(len(jax.devices('cpu')))"
    assert _run(code, XLA_FLAGS="--xla_force_host_platform_device_count=5").stdout.split() == ["5"]


def test_called_too_late_it_says_so_and_still_switches_float64_on():
    code = (
        "import jax; jax.numpy.ones(1) + 1; import frictionjax; frictionjax.configure_jax(); "
        "print(jax.numpy.ones(1).dtype)"
    )
    done = _run(code)
    assert done.stdout.split() == ["float64"]
    assert "JAX has computed something before `configure_jax()`" in done.stderr


def test_called_twice_it_is_silent():
    code = "import frictionjax, jax; frictionjax.configure_jax(); jax.numpy.ones(1) + 1; frictionjax.configure_jax()"
    done = _run(code)
    assert (done.returncode, done.stderr) == (0, "")


def test_flags_of_the_user_stay():
    mine = (
        "--xla_cpu_prefer_vector_width=256 "
        "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=false,other=1 --xla_dump_to=there "
        "--xla_cpu_use_fusion_emitters=true"
    )
    words = _with_our_flags(mine).split()
    assert "--xla_cpu_prefer_vector_width=256" in words
    assert "--xla_dump_to=there" in words
    options = next(word for word in words if "extra_options" in word).split("=", 1)[1].split(",")
    assert "xla_cpu_use_multi_output_fusion=false" in options
    assert "other=1" in options
    assert len(options) == 4
    assert "--xla_cpu_use_fusion_emitters=true" in words
    assert len(words) == 4


@pytest.mark.parametrize(("jaxlib", "older"), [("0.10.2", True), ("0.11.0", False), ("1.0.0.dev1", False)])
def test_no_flag_is_given_that_a_later_version_does_not_know(monkeypatch, jaxlib, older):
    monkeypatch.setattr(setup, "version", lambda name: jaxlib)
    assert ("--xla_cpu_use_fusion_emitters=false" in _with_our_flags("").split()) == older


def test_our_flags_are_not_added_twice():
    once = _with_our_flags("")
    assert _with_our_flags(once) == once


def test_no_device_is_refused():
    with pytest.raises(ValueError, match="at least one is needed"):
        frictionjax.configure_jax(cpu_devices=0)
