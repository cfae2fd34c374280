"""Cases: what the keys of a case file do to the recordings."""

import gzip

import numpy as np
import pytest
from scipy.io import savemat

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files, load_case

N, RATE = 400, 1000.0
T = np.arange(N) / RATE
U = np.sin(30.0 * T) + 0.3
X = 0.01 * np.cos(30.0 * T)


def write(path, header="t,u,x", channels=(T, U, X)):
    text = (
        header
        + "\n"
        + "".join(",".join(f"{v:.12g}" for v in row) + "\n" for row in zip(*channels, strict=True))
    )
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())


def load(folder, recording="", plant="", kept='file = "kept.csv"'):
    """A case of run.csv, with the keys `recording`, and a holdout."""
    if not (folder / "kept.csv").exists():
        write(folder / "kept.csv", channels=(T, U, X + 1.0))
    file = "" if recording.startswith("file") else 'file = "run.csv"\n'
    (folder / "case.toml").write_text(
        f'name = "arm"\n[plant]\n{plant}\n[[recording]]\n{file}{recording}\n[[recording]]\n{kept}\nrole = "holdout"\n'
    )
    return load_case(folder / "case.toml")


def test_defaults(tmp_path):
    write(tmp_path / "run.csv")
    case = load(tmp_path)
    run = case.recordings[0]
    assert (case.name, run.name, run.role, run.loop, run.drive) == ("arm", "run", "fit", "open", "force")
    assert (run.sample_rate, run.start_time, run.sampling.resampled) == (RATE, 0.0, False)
    assert (
        case.plant.motor_constant is None and case.plant.encoder_step is None and case.plant.inertia is None
    )
    assert [r.name for r in case.fit_recordings] == ["run"]
    assert [r.name for r in case.holdout_recordings] == ["kept"]
    np.testing.assert_allclose(run.x, X, rtol=1e-11)
    np.testing.assert_allclose(run.u, U, rtol=1e-11)
    np.testing.assert_allclose(run.t, T)
    assert run.v is None and run.force is None


def test_every_key_of_the_plant(tmp_path):
    write(tmp_path / "run.csv")
    units = 'position_unit = "rad"\nforce_unit = "N*m"\ninput_unit = "V"\n'
    plant = load(tmp_path, plant=units + "motor_constant = 16\nencoder_step = 9.6e-6\ninertia = 0.026").plant
    assert (plant.motor_constant, plant.encoder_step, plant.inertia) == (16.0, 9.6e-6, 0.026)
    assert (plant.position_unit, plant.force_unit, plant.input_unit) == ("rad", "N*m", "V")


def test_every_key_of_a_recording(tmp_path):
    write(tmp_path / "run.csv", "time,volt,mm,target,temp", (T, U, 1e3 * X, X, 20.0 + T))
    run = load(
        tmp_path,
        'role = "fit"\nloop = "closed"\ndrive = "force"\nstart_time = 36\nsample_rate = 1000.0\n'
        'columns = {t = "time", u = "volt", x = "mm", reference = "target", temperature = "temp"}\n'
        "scale = {x = 1e-3, u = -2}\ninterval = [0.1, 0.3]",
    ).recordings[0]
    assert (run.loop, run.sample_rate, run.x.size) == ("closed", 1000.0, 200)
    np.testing.assert_allclose(run.start_time, 36.1)
    np.testing.assert_allclose(run.x, X[100:300], rtol=1e-9)
    np.testing.assert_allclose(run.u, -2.0 * U[100:300], rtol=1e-9)
    assert run.reference is not None and run.temperature is not None
    np.testing.assert_allclose(run.reference, X[100:300], rtol=1e-9)
    np.testing.assert_allclose(run.temperature, 20.0 + T[100:300])


def test_optional_channels_are_found_by_their_names(tmp_path):
    write(tmp_path / "run.csv", "t,u,x,v,supply,other", (T, U, X, np.gradient(X, T), 24.0 + T, T))
    run = load(tmp_path).recordings[0]
    assert run.v is not None and run.supply is not None and run.normal_force is None


def test_a_file_without_time_needs_the_sample_rate(tmp_path):
    write(tmp_path / "run.csv", "u,x", (U, X))
    run = load(tmp_path, "sample_rate = 500.0\ninterval = [0.2, 0.5]").recordings[0]
    assert (run.sample_rate, run.x.size, run.start_time) == (500.0, 150, 0.2)


def test_time_in_milliseconds_is_scaled(tmp_path):
    write(tmp_path / "run.csv", channels=(1e3 * T, U, X))
    assert load(tmp_path, "scale = {t = 1e-3}").recordings[0].sample_rate == RATE
    with pytest.raises(InputError, match=r"sample rate would be 1 Hz.*--unit t=ms"):
        load(tmp_path)


def test_an_imposed_motion_has_a_force_and_no_input(tmp_path):
    write(tmp_path / "run.csv", "t,x,Friction [uN]", (T, X, 1e6 * np.sign(np.gradient(X))))
    run = load(
        tmp_path, 'drive = "motion"\ncolumns = {force = "Friction [uN]"}\nscale = {force = -1e-6}'
    ).recordings[0]
    assert run.drive == "motion" and not run.u.any() and run.u.shape == run.x.shape
    assert run.force is not None
    np.testing.assert_allclose(run.force, -np.sign(np.gradient(X)))


def test_one_file_in_two_parts(tmp_path):
    write(tmp_path / "run.csv")
    write(tmp_path / "run_2.csv", channels=(T, U, X + 2.0))
    case = load(
        tmp_path,
        'interval = [0.0, 0.15]\n[[recording]]\nfile = "run.csv"\ninterval = [0.15, 0.3]\n[[recording]]\n'
        'file = "run_2.csv"',
    )
    first, second, other, _ = case.recordings
    assert [r.name for r in case.recordings] == ["run", "run_2", "run_2_2", "kept"]
    assert (first.x.size, second.x.size, second.start_time) == (150, 150, 0.15)
    np.testing.assert_allclose(np.concatenate([first.x, second.x]), X[:300], rtol=1e-9)
    assert other.x[0] > 1.0


def test_names_differ_by_more_than_their_case(tmp_path):
    (tmp_path / "b").mkdir()
    write(tmp_path / "run.csv")
    write(tmp_path / "b" / "RUN.csv.gz", channels=(T, U, X + 2.0))
    case = load(tmp_path, '[[recording]]\nfile = "b/RUN.csv.gz"')
    assert [r.name for r in case.recordings] == ["run", "RUN_2", "kept"]


def test_a_case_without_a_name_is_called_after_its_folder_or_file(tmp_path):
    write(tmp_path / "run.csv")
    load(tmp_path)
    text = (tmp_path / "case.toml").read_text().replace('name = "arm"\n', "")
    (tmp_path / "case.toml").write_text(text)
    (tmp_path / "bench.toml").write_text("\ufeff" + text, encoding="utf-8")
    assert load_case(tmp_path / "case.toml").name == tmp_path.name
    assert load_case(str(tmp_path / "bench.toml")).name == "bench"


def test_paths_count_from_the_case_file(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    write(tmp_path / "data" / "run.csv")
    monkeypatch.chdir(tmp_path / "data")
    assert load(tmp_path, 'file = "data/run.csv"').recordings[0].name == "run"


def test_bare_files_give_the_same_recordings(tmp_path):
    write(tmp_path / "run.csv")
    from_toml = load(tmp_path, plant="motor_constant = 16.0")
    bare = case_from_files(tmp_path / "run.csv", [str(tmp_path / "kept.csv")], motor_constant=16.0)
    assert bare.name == "run" and bare.plant == from_toml.plant
    for one, other in zip(bare.recordings, from_toml.recordings, strict=True):
        assert (one.name, one.role, one.sample_rate) == (other.name, other.role, other.sample_rate)
        np.testing.assert_array_equal(one.x, other.x)


def test_bare_files_take_the_keys_of_a_case(tmp_path):
    for name, offset in (("a.csv", 0.0), ("b.csv", 1.0)):
        write(tmp_path / name, "volt,mm", (U, X + offset))
    case = case_from_files(
        [tmp_path / "a.csv"],
        tmp_path / "b.csv",
        sample_rate=2000.0,
        name="arm",
        position_unit="m",
        force_unit="N",
        input_unit="V",
        encoder_step=1e-6,
        inertia=2.0,
        loop="closed",
        columns={"u": "volt", "x": "mm"},
        scale={"x": 1e-3},
    )
    assert (case.name, case.plant.inertia, case.plant.position_unit) == ("arm", 2.0, "m")
    assert {(r.loop, r.sample_rate) for r in case.recordings} == {("closed", 2000.0)}


def test_a_mat_file_is_read_like_a_text_file(tmp_path):
    write(tmp_path / "run.csv")
    savemat(tmp_path / "run.mat", {"t": T, "u": U, "log": {"theta": X}, "v": np.arange(7.0), "fs": RATE})
    text = load(tmp_path).recordings[0]
    run = load(tmp_path, 'file = "run.mat"\ncolumns = {x = "log.theta"}').recordings[0]
    np.testing.assert_allclose(run.x, text.x, rtol=1e-11)
    assert run.v is None and "`v` has 7 samples" in run.warnings[0]


def test_resampling_is_reported_twice(tmp_path):
    keep = np.r_[0:100, 103:N]
    write(tmp_path / "run.csv", channels=(T[keep], U[keep], X[keep]))
    with pytest.warns(FrictionjaxWarning, match=r"run\.csv: The time stamps have 1 gap \(3 samples missing"):
        run = load(tmp_path).recordings[0]
    assert run.warnings[0].startswith("The time stamps have 1 gap")
    assert run.sampling.resampled and run.sampling.missing == 3
    np.testing.assert_allclose(run.x, X, atol=3e-5)
    assert run.x.size == N
