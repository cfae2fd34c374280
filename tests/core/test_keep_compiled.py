"""Compiled programs kept on disk: where, and when not."""

import os
import platform
import subprocess
import sys
import time
import zlib
from importlib.metadata import version
from pathlib import Path

import jax
import pytest

from frictionjax.core import keep_compiled, setup
from frictionjax.core.tidy import tidy


@pytest.fixture
def chosen():
    """Sets the folder that JAX has; afterwards it is what it was (an earlier test may have run the program here)."""
    before = jax.config.jax_compilation_cache_dir
    yield lambda folder: jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def told(chosen, monkeypatch):
    """What JAX is told where no folder has been chosen."""
    chosen(None)
    told = {}
    with monkeypatch.context() as patch:
        patch.setattr(jax.config, "update", told.__setitem__)
        yield told


def _kept_in(told):
    return Path(told["jax_compilation_cache_dir"])


def test_in_the_users_cache(told, tmp_path, monkeypatch):
    monkeypatch.setattr(setup, "user_cache_path", lambda name: tmp_path / name)
    keep_compiled()
    assert _kept_in(told).parent == tmp_path / "frictionjax" / "compiled"
    assert told["jax_persistent_cache_min_compile_time_secs"] == 0.0
    assert _kept_in(told).is_dir()


def test_in_a_folder_that_is_named(told, tmp_path):
    keep_compiled(tmp_path / "here")
    assert _kept_in(told).parent == tmp_path / "here"


# The first processor of two, with a clock rate that changes from one moment to the next.
_X86 = """processor\t: 0
model name\t: {model}
cpu MHz\t\t: {clock}
flags\t\t: fpu sse4_2 avx2{more}

processor\t: 1
model name\t: {model}
cpu MHz\t\t: 800.0
flags\t\t: fpu sse4_2 avx2{more}
"""
_ARM = """processor\t: 0
BogoMIPS\t: 50.00
Features\t: fp asimd{more}
CPU implementer\t: 0x41
CPU part\t: {part}
"""


def test_each_processor_has_a_folder_of_its_own(told, tmp_path, monkeypatch):
    """The instructions count beside the model's name, a clock rate does not."""
    monkeypatch.setattr(setup, "_CPUINFO", tmp_path / "cpuinfo")
    folders = []
    for text in (
        _X86.format(model="One", clock=2400.0, more=""),
        _X86.format(model="One", clock=3100.0, more=""),
        _X86.format(model="One", clock=2400.0, more=" avx512f"),
        _X86.format(model="Two", clock=2400.0, more=""),
        _ARM.format(part="0xd0c", more=""),
        _ARM.format(part="0xd40", more=""),
        _ARM.format(part="0xd40", more=" sve"),
    ):
        (tmp_path / "cpuinfo").write_text(text)
        keep_compiled(tmp_path / "here")
        folders.append(_kept_in(told))
    assert folders[0] == folders[1]
    assert len(set(folders)) == len(folders) - 1


def test_each_version_of_the_compiler_has_a_folder_of_its_own(told, tmp_path, monkeypatch):
    keep_compiled(tmp_path)
    first = _kept_in(told)
    assert first.name.endswith(f"-jaxlib-{version('jaxlib')}")
    monkeypatch.setattr(setup, "version", lambda name: "9.9.9")
    keep_compiled(tmp_path)
    assert _kept_in(told) != first


@pytest.mark.parametrize("system", ["Darwin", "Windows"])
def test_a_system_without_cpuinfo_is_asked_in_its_own_way(system, told, tmp_path, monkeypatch):
    model = ["Apple M1"]

    def sysctl(command, **_):
        return subprocess.CompletedProcess(command, 0, stdout=f"{model[-1]}\n")

    monkeypatch.setattr(setup, "_CPUINFO", tmp_path / "none")
    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(platform, "processor", lambda: "arm" if system == "Darwin" else model[-1])
    monkeypatch.setattr(setup.subprocess, "run", sysctl)
    keep_compiled(tmp_path)
    first = _kept_in(told)
    model.append("Apple M4")
    keep_compiled(tmp_path)
    assert _kept_in(told) != first


def test_a_folder_that_cannot_be_made_is_done_without(told, tmp_path):
    (tmp_path / "file").write_text("")
    keep_compiled(tmp_path / "file" / "folder")
    assert told == {}


def test_a_folder_that_cannot_be_written_is_done_without(told, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    keep_compiled(tmp_path)
    assert told == {}


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners here")
def test_the_folder_of_another_user_is_done_without(told, tmp_path, monkeypatch):
    """What lies in it would be run as it is."""
    another = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: another)
    keep_compiled(tmp_path)
    assert told == {}


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions here")
def test_the_folder_is_closed_to_what_others_would_add(told, tmp_path):
    keep_compiled(tmp_path)
    folder = _kept_in(told)
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    keep_compiled(tmp_path)
    assert folder.stat().st_mode & 0o777 == 0o700


def _entry(path, content, age=0):
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    now = time.time_ns() - age * 10**9
    os.utime(path, ns=(now, now))
    return path


def test_an_entry_that_was_cut_short_is_removed_at_the_next_start(tmp_path):
    """JAX never replaces one, and would compile again and say so at each start."""
    whole = zlib.compress(os.urandom(1000))
    kept = _entry(tmp_path / "one" / "jit_f-1-cache", whole)
    short = [
        _entry(tmp_path / "one" / f"jit_f-{k}-cache", part)
        for k, part in enumerate((b"", whole[:-1], b"?" * 9), start=2)
    ]
    program = _entry(tmp_path / "two" / "program", b"has a digest of its own")
    tidy(tmp_path)
    assert kept.exists()
    assert program.exists()
    assert not any(path.exists() for path in short)
    again = _entry(tmp_path / "one" / "jit_g-5-cache", whole[:-1])
    tidy(tmp_path)
    assert not again.exists()


def test_what_was_not_used_for_longest_goes_beyond_a_size(tmp_path):
    whole = zlib.compress(os.urandom(1000))
    ages = {age: _entry(tmp_path / "one" / f"jit_f-{age}-cache", whole, age) for age in (50, 10, 40, 30, 20)}
    tidy(tmp_path, largest=6000)
    assert all(path.exists() for path in ages.values())
    _entry(tmp_path / "one" / "jit_f-0-cache", whole)
    tidy(tmp_path, largest=3 * len(whole))
    assert {age for age, path in ages.items() if path.exists()} <= {10}


def test_the_size_counts_what_jax_keeps_and_whole_programs_together(tmp_path):
    whole = zlib.compress(os.urandom(1000))
    jax_own = [_entry(tmp_path / "one" / f"jit_f-{age}-cache", whole, age) for age in (5, 3)]
    ours = [_entry(tmp_path / "one" / "frictionjax" / f"{age}", whole, age) for age in (4, 2)]
    tidy(tmp_path, largest=4 * len(whole))
    assert all(path.exists() for path in (*jax_own, *ours))
    _entry(tmp_path / "one" / "frictionjax" / "new", whole)
    tidy(tmp_path, largest=4 * len(whole))
    assert [path.exists() for path in (jax_own[0], ours[0], jax_own[1], ours[1])] == [
        False,
        False,
        True,
        True,
    ]
    left = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    assert left <= 4 * len(whole)


def test_what_was_chosen_before_stays(chosen, tmp_path):
    chosen(str(tmp_path / "chosen"))
    keep_compiled(tmp_path / "asked")
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "chosen")
    assert not (tmp_path / "asked").exists()


_TWICE = """
import pathlib, sys, warnings
import jax
folder = pathlib.Path(sys.argv[1])
double = jax.jit(lambda x: 2.0 * x)
assert double(3.0) == 6.0
kept = list(folder.glob("*lambda*-cache"))
assert len(kept) == 1, list(folder.iterdir())
whole = kept[0].read_bytes()
for part in (b"", whole[: len(whole) // 2], b"?" * 100):
    kept[0].write_bytes(part)
    jax.clear_caches()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert double(3.0) == 6.0
    print(len(said), str(said[0].message).partition(" entry")[0])
"""


def test_a_program_that_is_half_written_is_compiled_again(tmp_path):
    """JAX writes it in place, so that another process may read a part of it; pyproject.toml excepts these words."""
    choices = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    command = [sys.executable, "-c", _TWICE, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | choices)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["1 Error reading persistent compilation cache"] * 3


@pytest.mark.parametrize("name", ["", "gs://bucket/programs"])
def test_whole_programs_are_kept_in_a_folder_of_this_machine_only(chosen, name, tmp_path, monkeypatch):
    """An empty name is no folder, in particular not the one where the program was started."""
    monkeypatch.chdir(tmp_path)
    chosen(name)
    assert setup.programs_folder() is None
    assert list(tmp_path.iterdir()) == []
    chosen(str(tmp_path / "here"))
    assert setup.programs_folder() == tmp_path / "here" / "frictionjax"
