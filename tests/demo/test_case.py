"""The demo's case: files in the contract's form, the same from the same seed, from a world of its own."""

import ast
import json
import time
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest

import frictionjax.demo
from frictionjax.demo import write_demo_case

RECORDINGS = {
    "noise_small": ("fit", "open"),
    "noise_large": ("fit", "open"),
    "breakaway": ("fit", "open"),
    "stick_sine": ("fit", "open"),
    "moves": ("fit", "closed"),
    "sweep": ("fit", "closed"),
    "holdout_stick": ("holdout", "open"),
    "holdout_moves": ("holdout", "closed"),
}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Folder of the written case, and how long processors worked for it, s."""
    folder = tmp_path_factory.mktemp("demo") / "not" / "there" / "yet"
    start = time.process_time()
    path = write_demo_case(folder)
    seconds = time.process_time() - start
    assert path == folder / "case.toml"
    return folder, seconds


def _read(folder, name):
    return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1, unpack=True)


def test_the_case_is_written_in_time(case):
    assert case[1] < 10.0


def test_the_case_file_has_the_form_of_the_contract(case):
    folder, _ = case
    description = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    plant = description["plant"]
    assert (plant["position_unit"], plant["force_unit"], plant["input_unit"]) == ("rad", "N*m", "V")
    assert plant["motor_constant"] == 16.0
    assert plant["encoder_step"] > 0.0
    assert "inertia" not in plant
    reported = {Path(r["file"]).stem: (r["role"], r["loop"]) for r in description["recording"]}
    assert reported == RECORDINGS
    starts = [r["start_time"] for r in description["recording"]]
    lengths = [_read(folder, name)[0].size / 2000.0 for name in RECORDINGS]
    assert all(a + n < b for a, n, b in zip(starts[:-1], lengths[:-1], starts[1:], strict=True))


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_is_uniform_quantised_and_moves(case, name):
    folder, _ = case
    assert (folder / f"{name}.csv").read_text(encoding="utf-8").startswith("t,u,x\n")
    t, u, x = _read(folder, name)
    assert 5.0 <= t.size / 2000.0 <= 7.0
    assert np.allclose(t, np.arange(t.size) / 2000.0, rtol=0.0, atol=1e-9)
    step = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))["plant"]["encoder_step"]
    assert np.max(np.abs(x / step - np.round(x / step))) < 1e-3
    assert np.std(u) > 0.0
    assert np.std(x) > 5.0 * step


def test_the_levels_are_those_that_the_recordings_are_named_for(case):
    folder, _ = case
    base = json.loads((folder / "sealed" / "truth.json").read_text(encoding="utf-8"))["base"]
    level = {name: 16.0 * _read(folder, name)[1] / base["Fs"] for name in RECORDINGS}
    travel = {name: np.ptp(_read(folder, name)[2]) * base["sigma0"] / base["Fs"] for name in RECORDINGS}
    assert 0.10 < np.std(level["noise_small"]) < 0.15
    assert 0.30 < np.std(level["noise_large"]) < 0.40
    for name in ("noise_small", "noise_large", "stick_sine", "holdout_stick"):
        assert travel[name] < 10.0, f"{name} leaves presliding"
    for name in ("breakaway", "moves", "sweep", "holdout_moves"):
        assert travel[name] > 100.0, f"{name} never slides"
    assert np.max(np.abs(level["stick_sine"])) < 1.0
    assert np.max(np.abs(level["holdout_stick"])) < 1.0
    assert np.max(level["breakaway"]) > 1.0
    assert np.min(level["breakaway"]) < -1.0


def test_only_the_sealed_folder_tells_the_truth(case, tmp_path):
    folder, _ = case
    truth = json.loads((folder / "sealed" / "truth.json").read_text(encoding="utf-8"))
    assert truth["missing"] == ["maxwell_slip"]
    assert 0.6 <= truth["maxwell_slip"]["share"] <= 1.0
    assert set(truth["base"]) == {"J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs"}
    assert sorted(p.name for p in folder.iterdir()) == sorted(
        ["case.toml", "sealed", *(f"{name}.csv" for name in RECORDINGS)]
    )
    assert "maxwell" not in (folder / "case.toml").read_text(encoding="utf-8")
    write_demo_case(tmp_path, base=True)
    null = json.loads((tmp_path / "sealed" / "truth.json").read_text(encoding="utf-8"))
    assert null["missing"] == []
    assert null["base"] == truth["base"]


def test_the_same_seed_writes_the_same_files(case, tmp_path):
    folder, _ = case
    reported = []
    write_demo_case(tmp_path / "again", progress=lambda stage, fraction: reported.append((stage, fraction)))
    write_demo_case(tmp_path / "other", seed=7)
    for name in [*(f"{name}.csv" for name in RECORDINGS), "case.toml", "sealed/truth.json"]:
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()
    assert (tmp_path / "other" / "moves.csv").read_bytes() != (folder / "moves.csv").read_bytes()
    fractions = [fraction for _, fraction in reported]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)


def test_float32_is_refused(tmp_path):
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="float64"):
        write_demo_case(tmp_path / "never")
    assert not (tmp_path / "never").exists()


def test_the_demo_knows_nothing_of_the_package():
    """Reality leans on no model: of frictionjax it imports its own files and the protocol of progress."""
    for path in Path(frictionjax.demo.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module or ""]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            for name in names:
                if name.split(".")[0] == "frictionjax":
                    assert name == "frictionjax.core.progress" or name.startswith("frictionjax.demo.")
