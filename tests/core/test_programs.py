"""Compiled programs that are kept: made once, found without tracing, never taken from what is damaged or foreign."""

import gc
import os
import subprocess
import sys
import threading
import weakref

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.core import FrictionjaxWarning, programs
from frictionjax.core.programs import compiled, forget_programs
from frictionjax.simulation import ObserverGains


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder for programs."""
    monkeypatch.setattr(programs, "programs_folder", lambda: tmp_path)
    forget_programs()
    return tmp_path


class Counted:
    """A compiled function, and how often it was traced."""

    def __init__(self, module="frictionjax.core.example"):
        self.traces = 0

        def scaled(gains, x, *more):
            self.traces += 1
            return ObserverGains(gains.position * x, gains.velocity + jnp.sum(x)), x**2

        scaled.__module__ = module
        self.run = compiled()(scaled)


GAINS, X = ObserverGains(np.asarray(2.0), np.asarray(3.0)), np.arange(4.0)


def _checked(found, x=X):
    gains, squares = found
    assert isinstance(gains, ObserverGains)
    np.testing.assert_array_equal(gains.position, 2.0 * x)
    np.testing.assert_array_equal(gains.velocity, 3.0 + x.sum())
    np.testing.assert_array_equal(squares, x**2)


def test_a_program_serves_all_numbers_and_each_shape_has_its_own(folder):
    counted = Counted()
    for factor in (1.0, 5.0):
        _checked(counted.run(GAINS, factor * X), factor * X)
    _checked(counted.run(GAINS, jnp.asarray(X)))
    assert counted.traces == 1
    _checked(counted.run(GAINS, np.arange(6.0)), np.arange(6.0))
    assert counted.traces == 2


def test_a_kept_program_is_found_without_tracing(folder):
    counted = Counted()
    _checked(counted.run(GAINS, X))
    forget_programs()
    _checked(counted.run(GAINS, X))
    assert counted.traces == 1
    assert len(list(folder.iterdir())) == 1


def test_a_damaged_program_is_made_again_and_replaced(folder):
    counted = Counted()
    counted.run(GAINS, X)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    for damaged in (whole[:100], whole[:-1] + b"?", b""):
        path.write_bytes(damaged)
        forget_programs()
        with pytest.warns(FrictionjaxWarning, match="damaged"):
            _checked(counted.run(GAINS, X))
    assert counted.traces == 4
    forget_programs()
    _checked(counted.run(GAINS, X))
    assert counted.traces == 4


def test_the_program_of_another_user_is_not_run(folder, monkeypatch):
    counted = Counted()
    counted.run(GAINS, X)
    forget_programs()
    monkeypatch.setattr(programs.os, "getuid", lambda: -1)
    _checked(counted.run(GAINS, X))
    assert counted.traces == 2


def test_a_result_is_not_lost_where_its_program_cannot_be_kept(folder, monkeypatch):
    write = type(folder).write_bytes

    def full(path, content):
        if path.parent == folder:
            write(path, content[:10])
            raise OSError(28, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(type(folder), "write_bytes", full)
    with pytest.warns(FrictionjaxWarning, match="No space left"):
        _checked(Counted().run(GAINS, X))
    assert not list(folder.iterdir())


def test_programs_depend_on_the_source_of_the_package(folder, monkeypatch):
    counted = Counted()
    counted.run(GAINS, X)
    forget_programs()
    monkeypatch.setattr(programs, "_source", lambda unit: "changed")
    counted.run(GAINS, X)
    assert counted.traces == 2
    assert len(list(folder.iterdir())) == 2


class Foreign(eqx.Module):
    """Whoever writes this class may change its code without a trace in the key of a program."""

    value: jax.Array


@pytest.mark.parametrize(
    ("module", "more"),
    [
        ("frictionjax.core.example", Foreign(jnp.asarray(1.0))),
        ("somewhere.else", X),
        ("frictionjax.core.example", _checked),
    ],
    ids=["class", "function", "argument"],
)
def test_what_others_wrote_is_compiled_and_not_kept(folder, module, more):
    counted = Counted(module)
    for _ in range(2):
        _checked(counted.run(GAINS, X, more))
    assert counted.traces == 1
    assert not list(folder.iterdir())


def test_inside_transformations_it_is_the_function_itself(folder):
    counted = Counted()
    slope = jax.grad(lambda x: jnp.sum(counted.run(GAINS, x)[1]))(jnp.asarray(X))
    np.testing.assert_array_equal(slope, 2.0 * X)
    both = jax.vmap(lambda x: counted.run(GAINS, x)[1])(jnp.stack([X, 2.0 * X]))
    np.testing.assert_array_equal(both, np.stack([X**2, 4.0 * X**2]))
    assert not list(folder.iterdir())


def test_threads_that_need_one_program_make_it_once(folder):
    counted = Counted()
    threads = [threading.Thread(target=counted.run, args=(GAINS, X)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counted.traces == 1


def test_without_a_folder_each_process_makes_its_own(monkeypatch):
    monkeypatch.setattr(programs, "programs_folder", lambda: None)
    forget_programs()
    counted = Counted()
    _checked(counted.run(GAINS, X))
    assert counted.traces == 1


def test_no_more_programs_are_held_than_there_is_room_for(folder, monkeypatch):
    monkeypatch.setattr(programs, "_MOST", 2)
    counted = Counted()
    for length in (3, 4, 5, 5, 3):
        counted.run(GAINS, np.arange(float(length)))
    assert len(programs._MEMORY._programs) == 2
    assert counted.traces == 3


def test_structures_that_were_not_used_for_longest_are_let_go(monkeypatch):
    """With their programs: nothing else refers to them."""
    monkeypatch.setattr(programs, "_MOST_STRUCTURES", 2)
    forget_programs()
    traces = []

    def halved(x, parts):
        traces.append(len(parts))
        return ObserverGains(0.5 * x, sum(parts))

    run = programs.Jitted(halved)
    for count in (1, 2, 1, 3, 1, 2):
        found = run(X, (X,) * count)
        np.testing.assert_array_equal(found.position, 0.5 * X)
        np.testing.assert_array_equal(found.velocity, count * X)
    assert traces == [1, 2, 3, 2]
    assert programs.programs_held() == 2
    slope = jax.grad(lambda x: jnp.sum(run(x, (x,)).velocity * x))(jnp.asarray(X))
    np.testing.assert_array_equal(slope, 2.0 * X)


def test_the_programs_of_a_structure_go_with_it(monkeypatch):
    monkeypatch.setattr(programs, "_MOST_STRUCTURES", 1)
    forget_programs()
    run = programs.Jitted(lambda x, parts: x + len(parts))
    run(X, (1,))
    ((traced,),) = [programs._STRUCTURES._programs.values()]
    gone = weakref.ref(traced)
    del traced
    run(X, (1, 2))
    gc.collect()
    assert gone() is None


_ONCE = """
import pathlib, sys
import numpy as np
from frictionjax.core.programs import compiled, forget_programs

def double(x, *more):
    return 2.0 * x

double.__module__ = "frictionjax.core.example"
run = compiled()(double)
run(np.arange(3.0))
own = [path.name for path in pathlib.Path(sys.argv[1]).rglob("*") if path.is_file()]
assert len(own) == 1 and not own[0].startswith("jit_"), own
run(np.arange(3.0), lambda: 0)  # not kept here: JAX does
names = [path.name for path in pathlib.Path(sys.argv[1]).glob("jit_double-*")]
assert len(names) == 1, names
"""


def test_a_program_lies_on_the_disk_once(tmp_path):
    """JAX keeps a copy of each under a name that nothing asks for again."""
    choices = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    command = [sys.executable, "-c", _ONCE, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | choices)
    assert done.returncode == 0, done.stderr
