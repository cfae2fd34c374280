"""Compiled programs kept on disk: where, and when not."""

import jax
import pytest

from frictionjax.core import keep_compiled, setup


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


def test_in_the_users_cache(told, tmp_path, monkeypatch):
    monkeypatch.setattr(setup, "user_cache_path", lambda name: tmp_path / name)
    keep_compiled()
    assert told["jax_compilation_cache_dir"] == str(tmp_path / "frictionjax" / "compiled")
    assert told["jax_persistent_cache_min_compile_time_secs"] == 0.0
    assert (tmp_path / "frictionjax" / "compiled").is_dir()


def test_in_a_folder_that_is_named(told, tmp_path):
    keep_compiled(tmp_path / "here")
    assert told["jax_compilation_cache_dir"] == str(tmp_path / "here")


def test_a_folder_that_cannot_be_made_is_done_without(told, tmp_path):
    (tmp_path / "file").write_text("")
    keep_compiled(tmp_path / "file" / "folder")
    assert told == {}


def test_what_was_chosen_before_stays(chosen, tmp_path):
    chosen(str(tmp_path / "chosen"))
    keep_compiled(tmp_path / "asked")
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "chosen")
    assert not (tmp_path / "asked").exists()
