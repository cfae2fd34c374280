"""Published machines: found by checksum, refused with a cure, cut as the notebook says."""

import dataclasses
import hashlib
import importlib.machinery
import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from frictionjax.core import InputError
from frictionjax.recordings.case import case_from_table
from frictionjax.studies.real_machines import MACHINES, VARIABLE, files_of, load_machine, load_speed_error

REAL = Path(__file__).parents[3] / "shared" / "real"


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(InputError, match="emps, motor_bench, tribometer, pendulum"):
        load_machine("robot")


@pytest.mark.parametrize("name", MACHINES)
def test_what_is_absent_is_said_with_where_to_get_it(name, tmp_path):
    with pytest.raises(InputError, match="is not on this disk") as raised:
        files_of(name, [tmp_path])
    assert MACHINES[name].source.split()[0] in str(raised.value)
    assert VARIABLE in str(raised.value)


def test_another_file_of_the_same_name_is_refused(tmp_path):
    (tmp_path / "test_data_2.txt").write_text("t\tx\n0\t1\n")
    with pytest.raises(InputError, match="not the file that was published"):
        files_of("tribometer", [tmp_path])


def test_the_environment_names_the_folders(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "test_data_2.txt").write_text("something else")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(InputError, match="deep"):
        files_of("tribometer")


def _fetcher(monkeypatch, fetch):
    """Stands for the package nonlinear-benchmarks; `fetch` is its EMPS."""
    package = types.ModuleType("nonlinear_benchmarks")
    package.__spec__ = importlib.machinery.ModuleSpec("nonlinear_benchmarks", None)
    monkeypatch.setattr(package, "EMPS", fetch, raising=False)
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", package)


def _as_published(monkeypatch, contents):
    """Of the ball screw, files with these contents count as the published ones."""
    sums = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in contents.items()}
    monkeypatch.setitem(MACHINES, "emps", dataclasses.replace(MACHINES["emps"], files=sums))


def test_without_the_package_that_fetches_its_command_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"not installed.*pip install \"frictionjax\[benchmarks-data\]\""):
        load_machine("emps", [tmp_path], download=True)


def test_nothing_is_fetched_that_is_on_this_disk(tmp_path, monkeypatch):
    contents = {"DATA_EMPS.mat": "one", "DATA_EMPS_PULSES.mat": "two"}
    _as_published(monkeypatch, contents)
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert files_of("emps", [tmp_path], download=True) == {name: tmp_path / name for name in contents}


@pytest.mark.parametrize(
    "raised", [OSError("no route to host"), Exception("Download failed after 5 attempts")]
)
def test_without_a_network_the_error_has_a_cure(tmp_path, monkeypatch, raised):
    def fetch(**_):
        raise raised

    _fetcher(monkeypatch, fetch)
    with pytest.raises(InputError, match=f"could not fetch.*network.*by hand.*{VARIABLE}") as said:
        load_machine("emps", [tmp_path], download=True)
    assert said.value.__cause__ is raised


def test_an_archive_that_was_not_unpacked_is_fetched_again(tmp_path, monkeypatch):
    contents = {"DATA_EMPS.mat": "one", "DATA_EMPS_PULSES.mat": "two"}
    _as_published(monkeypatch, contents)
    kept, asked = tmp_path / "kept", []
    kept.mkdir()

    def fetch(*, data_file_locations, force_download=False):
        assert data_file_locations
        asked.append(force_download)
        for name, text in contents.items() if force_download else ():
            (kept / name).write_text(text)
        return [str(kept / name) for name in contents]

    _fetcher(monkeypatch, fetch)
    (tmp_path / "empty").mkdir()
    assert files_of("emps", [tmp_path / "empty"], download=True) == {name: kept / name for name in contents}
    assert asked == [False, True]


EXPECTED = {
    "emps": (1, 1, 1000.0),
    "motor_bench": (1, 1, 2500.0),
    "tribometer": (12, 12, 200.0),
    "pendulum": (9, 3, 188.0),
}


@pytest.mark.parametrize("name", MACHINES)
def test_the_recordings_are_cut_as_the_notebook_says(name):
    try:
        case = load_machine(name, [REAL] if REAL.is_dir() else [])
    except InputError as absent:
        pytest.skip(str(absent))
    fit, held, rate = EXPECTED[name]
    assert (len(case.fit_recordings), len(case.holdout_recordings)) == (fit, held)
    assert {recording.sample_rate for recording in case.recordings} == {rate}


def _log(path, gain):
    """A servo's log as it is published: 300 rows, the duty a signed 16-bit register that is shown unsigned."""
    t = 100.0 + np.arange(300) / 190.0
    rows = [
        {
            "timestamp": s,
            "position": 1e-3 * gain * np.sin(s),
            "load": 443 if s < 100.8 else 65536 - 885,
            "input_volts": 7.0,
        }
        for s in t
    ]
    path.write_text(json.dumps({"kp": gain, "trajectory": "sine", "entries": rows}))


def test_a_log_of_the_servo_becomes_volts_at_one_rate(tmp_path):
    files = {f"{gain}.json": tmp_path / f"{gain}.json" for gain in (100, 200)}
    for name, path in files.items():
        _log(path, int(name.split(".")[0]))
    case = case_from_table(MACHINES["pendulum"].table(files, tmp_path), "pendulum")
    assert [r.role for r in case.recordings] == ["fit", "holdout"]
    run = case.recordings[0]
    assert (run.sample_rate, run.loop, case.name) == (188.0, "closed", "pendulum")
    assert run.u[0] == pytest.approx(443 / 885 * 7.0) and run.u[-1] == pytest.approx(-7.0)
    np.testing.assert_allclose(run.x, 0.1 * np.sin(100.0 + np.arange(run.x.size) / 188.0), atol=1e-5)


def test_a_load_behind_a_spring_is_distinguished_from_a_stiff_shaft():
    """Speeds made by the transfer function itself, solved from both equations line by line, and by a stiff shaft."""
    count, lines = 2500, np.arange(11, 250)
    p, circular = 2j * np.pi * lines, 2.0 * np.pi * 54.0
    coupling = circular**2 + 2.0 * 0.03 * circular * p  # torque for a twist, over the load's inertia
    passed = coupling / (p**2 + 9.0 * p + coupling)
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random(lines.size))
    spectra = np.zeros((3, count // 2 + 1), complex)
    spectra[0, lines], spectra[1, lines], spectra[2, lines] = phases, -passed * phases, -phases
    motor, sprung, stiff = (np.tile(np.fft.irfft(spectrum, count), 5) for spectrum in spectra)
    assert load_speed_error(motor, sprung, 54.0, 0.03, 9.0) < 1e-9
    assert load_speed_error(motor, stiff, np.inf, 0.03, 9.0) < 1e-9
    assert load_speed_error(motor, sprung, 50.0, 0.03, 9.0) > 0.1
    assert load_speed_error(motor, sprung, 54.0, 0.03, 0.0) > 0.01
    assert load_speed_error(motor, sprung, np.inf, 0.03, 9.0) > 0.5
