"""Processes that `fork` copied after JAX had computed: its threads are missing there, and it would wait for ever."""

import os


class _Process:
    """Whether this process has `computed`, and whether it is a copy (`forked`) of one that had."""

    computed = False
    forked = False


def require_own_threads() -> None:
    """Raise `RuntimeError` in a process that `fork` made of one in which this library had computed; every verb asks.

    Otherwise the first computation would wait for threads that such a copy does not have.
    """
    if _Process.forked:
        raise RuntimeError(
            "This process was copied by `fork` after JAX had computed, and would wait for ever for JAX's threads. "
            'Start processes by `spawn`: multiprocessing.get_context("spawn"), or ProcessPoolExecutor(mp_context=...).'
        )
    _Process.computed = True


def _after_fork() -> None:
    _Process.forked = _Process.computed


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
