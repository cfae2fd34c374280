"""A single recording: its end is held out."""

import numpy as np
import pytest
from helpers_recordings import HEADER

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import Case, Plant, Recording, case_from_files, hold_out_last_third, load_case


def _csv(folder, rows=900):
    t = np.arange(rows) / 1000.0
    file = folder / "run.csv"
    np.savetxt(
        file,
        np.column_stack([t, np.sin(9.0 * t), np.cos(7.0 * t)]),
        delimiter=",",
        header="t,u,x",
        comments="",
    )
    return file


def test_of_a_single_file_the_last_third_is_held_out_and_reported(tmp_path):
    with pytest.warns(FrictionjaxWarning, match=r"the last third \(0.3 s\) was held out"):
        case = case_from_files(_csv(tmp_path))
    (fit,), (held,) = case.fit_recordings, case.holdout_recordings
    assert (fit.name, held.name) == ("run", "run_last_third")
    assert (fit.x.size, held.x.size) == (600, 300)
    t = np.arange(900) / 1000.0
    np.testing.assert_allclose(np.concatenate([fit.x, held.x]), np.cos(7.0 * t))
    np.testing.assert_allclose(np.concatenate([fit.u, held.u]), np.sin(9.0 * t))
    assert held.start_time == pytest.approx(0.6)
    assert "A second recording validates better" in fit.warnings[-1]


def test_with_a_holdout_nothing_is_divided_and_nothing_said(tmp_path, recwarn):
    other = tmp_path / "kept.csv"
    t = np.arange(400) / 1000.0
    np.savetxt(other, np.column_stack([t, np.cos(t), np.sin(t)]), delimiter=",", header="t,u,x", comments="")
    case = case_from_files(_csv(tmp_path), other)
    assert [r.x.size for r in case.recordings] == [900, 400]
    assert not recwarn


def test_every_channel_is_divided():
    n = 600
    force = np.arange(n, dtype=float)
    one = Recording("a", 100.0, np.zeros(n), np.sin(force), drive="motion", force=force, start_time=5.0)
    with pytest.warns(FrictionjaxWarning):
        fit, held = hold_out_last_third(Case("bench", Plant(), (one,))).recordings
    np.testing.assert_array_equal(np.concatenate([fit.force, held.force]), force)
    assert held.start_time == pytest.approx(9.0)
    assert held.drive == "motion"


def test_two_recordings_are_not_divided():
    one = Recording("a", 100.0, np.ones(600), np.ones(600))
    with pytest.raises(InputError, match=r'there are 2 recordings.*role = "holdout"'):
        hold_out_last_third(Case("bench", Plant(), (one, one)))


def test_a_case_file_of_one_recording_is_divided_like_a_bare_file(tmp_path):
    _csv(tmp_path)
    file = tmp_path / "case.toml"
    file.write_text(HEADER + '[[recording]]\nfile = "run.csv"\n')
    with pytest.warns(FrictionjaxWarning, match=r"the last third \(0.3 s\) was held out"):
        case = load_case(file)
    assert [(r.name, r.role, r.x.size) for r in case.recordings] == [
        ("run", "fit", 600),
        ("run_last_third", "holdout", 300),
    ]


def test_a_case_file_of_two_recordings_says_itself_what_is_held_out(tmp_path):
    _csv(tmp_path)
    file = tmp_path / "case.toml"
    entry = '[[recording]]\nfile = "run.csv"\ninterval = [{}]\n'
    file.write_text(HEADER + entry.format("0.0, 0.4") + entry.format("0.4, 0.8"))
    with pytest.raises(InputError, match="a file may occur twice, with an interval each"):
        load_case(file)
