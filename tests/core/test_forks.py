"""A process that was copied after JAX computed refuses to compute, in a sentence, and does not wait for ever."""

import os
import warnings

import pytest

from frictionjax.core import require_x64
from frictionjax.core.forks import _Process


def status_of(act):
    """The exit status of a copy of this process that does `act`: 7 where it raises the sentence."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX and of Python, about what is tested here
        child = os.fork()
    if not child:
        status = 1
        try:
            act()
            status = 0
        except RuntimeError as error:
            status = 7 if "multiprocessing.get_context" in str(error) else 2
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not copied here")
def test_a_copy_made_after_a_computation_refuses(monkeypatch):
    monkeypatch.setattr(_Process, "computed", False)
    assert status_of(require_x64) == 0
    require_x64()
    assert status_of(require_x64) == 7
    require_x64()
