"""Memory that is freed is there for the next array; elsewhere than on Linux nothing happens."""

import os
import platform
import subprocess
import sys

import pytest

from frictionjax.core import keep_memory, setup

_FAULTS = """
import resource, sys
from frictionjax.core import keep_memory
if sys.argv[1] == "kept":
    keep_memory()
begun = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    large = b"x" * 40_000_000
    del large
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begun)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_a_large_array_takes_the_place_of_the_one_before_it():
    """Of twenty arrays in turn the first alone is new to the system, and without the setting each is."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    faults = {}
    for how in ("left", "kept"):
        done = subprocess.run(
            [sys.executable, "-c", _FAULTS, how], capture_output=True, text=True, check=False, env=plain
        )
        assert done.returncode == 0, done.stderr
        faults[how] = int(done.stdout)
    assert faults["kept"] < 0.2 * faults["left"]


def test_another_c_library_is_left_alone(monkeypatch):
    monkeypatch.setattr(setup.platform, "libc_ver", lambda: ("", ""))
    monkeypatch.setattr(setup.ctypes, "CDLL", lambda name: pytest.fail("it was asked"))
    keep_memory()
