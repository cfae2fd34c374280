"""Compilation is counted once, whatever number of threads compile at a time."""

import time

import pytest

from frictionjax.core.compile_time import CompileClock, Stages


@pytest.fixture
def clock(monkeypatch):
    """A clock that was made ten seconds ago, in a process that has compiled nothing."""
    monkeypatch.setattr(CompileClock, "_intervals", [])
    clock = CompileClock()
    clock._made -= 10.0
    return clock


def test_threads_that_compile_at_one_time_count_once(clock):
    begin = clock._made
    for seconds, end in ((2.0, 3.0), (1.0, 3.5), (0.5, 6.0), (3.0, 7.0)):
        CompileClock.compiled(seconds, begin + end)
    # 1 to 3.5, and 4 to 7.
    assert clock.seconds == pytest.approx(2.5 + 3.0)


def test_what_was_compiled_before_does_not_count(clock):
    CompileClock.compiled(5.0, clock._made - 1.0)
    CompileClock.compiled(4.0, clock._made + 1.0)
    assert clock.seconds == pytest.approx(1.0)


def test_compilation_is_never_more_than_the_total():
    stages, clock = Stages(), CompileClock()
    time.sleep(0.03)
    for _ in range(4):
        CompileClock.compiled(0.02, time.perf_counter())
    report = stages.report(clock)
    assert 0.0 < report["compile"] <= report["total"]
