"""What `save_diagnosis` leaves behind: the contract's files, whole or not at all."""

import dataclasses
import json
import types
import unicodedata

import equinox as eqx
import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis, fake_recording
from helpers_rule import row, table

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.diagnosis.table import table_of
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.report import check_writable, save, save_diagnosis
from frictionjax.report.fit_csv import fit_files

HEADER = "t,u,x,free_base,free_extended,predicted_base,predicted_extended,residual_force,residual_force_std"


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """The report has tests of its own, and takes a second to draw."""

    def write(diagnosis, directory):
        (directory / "report.html").write_text(f"<title>{diagnosis.case}</title>")

    monkeypatch.setattr(save, "write_report", write)


def strict(text: str):
    """Parse strict JSON: NaN and Infinity are errors."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def listing(directory):
    return {
        str(path.relative_to(directory)): path.is_file() and path.read_bytes()
        for path in directory.rglob("*")
    }


def test_verdict_has_the_schema_of_the_contract(tmp_path):
    fake_diagnosis().save(tmp_path / "out")
    verdict = strict((tmp_path / "out" / "verdict.json").read_text(encoding="utf-8"))
    contract = [
        "schema",
        "case",
        "verdict",
        "summary",
        "missing",
        "unexplained",
        "mismatch",
        "base",
        "extended",
    ]
    contract += ["fit", "candidates", "warnings", "seconds"]
    assert list(verdict)[: len(contract)] == contract
    assert verdict["schema"] == "frictionjax.verdict/1"
    assert verdict["verdict"] == "named"
    (missing,) = verdict["missing"]
    assert {"effect", "class", "confidence", "p_value", "parameters", "where", "split_by"} <= set(missing)
    assert missing["class"] == ["maxwell_slip", "elasto_plastic"]
    assert missing["parameters"]["share"]["value"] == 0.42
    assert missing["parameters"]["share"]["unit"] == "1"
    assert set(verdict["unexplained"]) == {"present", "share", "where", "carried_by", "explains"}
    assert {"axis", "bin", "share", "excess", "p_value"} <= set(verdict["mismatch"][0])
    assert verdict["mismatch"][-1]["p_value"] == 0.005
    (within,) = verdict["mismatch_within"]
    assert (within["axis"], within["bin"], within["only"]) == ("dwell", "after rests longer than 0.3 s", True)
    assert {"value", "stderr", "unit"} <= set(verdict["base"]["parameters"]["J"])
    assert "maxwell_slip.share" in verdict["extended"]["parameters"]
    fit = verdict["fit"]["holdout_stick"]
    assert set(fit) == {"role", "noise_floor", "base", "extended", "horizons", "file"}
    assert [set(one) for one in fit["horizons"]] == [{"seconds", "base", "extended", "standstill"}] * 3
    assert fit["base"]["unmeasured_force"] == {"force": 0.08, "of_coulomb": 0.16, "of_applied": 0.3}
    assert fit["file"] == "fit/holdout_stick.csv"
    assert (
        set(fit["base"]) == set(fit["extended"]) == {"free_run_rmse", "prediction_rmse", "unmeasured_force"}
    )
    assert fit["base"]["prediction_rmse"] > 5 * fit["extended"]["prediction_rmse"]
    assert {"effect", "p_value", "minimum_detectable", "tested", "reason"} <= set(verdict["candidates"][0])
    assert {"total", "compile"} <= set(verdict["seconds"])


def test_what_is_not_finite_is_null(tmp_path):
    fake_diagnosis().save(tmp_path)
    verdict = strict((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["base"]["parameters"]["sigma2"]["stderr"] is None
    assert verdict["candidates"][2]["p_value"] is None


def test_an_adequate_case_with_empty_lists(tmp_path):
    adequate_diagnosis().save(tmp_path)
    verdict = strict((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["missing"] == verdict["mismatch"] == verdict["candidates"] == verdict["warnings"] == []


def test_csv_holds_the_arrays_to_nine_digits(tmp_path):
    recording = fake_recording("run", n=5000)
    recording = eqx.tree_at(lambda r: r.free_base, recording, recording.free_base.copy())
    recording.free_base[7] = np.nan
    eqx.tree_at(lambda d: d.recordings, fake_diagnosis(), (recording,)).save(tmp_path)
    file = tmp_path / "fit" / "run.csv"
    assert file.read_text().splitlines()[0] == HEADER
    table = np.genfromtxt(file, delimiter=",", names=True)
    assert table.shape == (5000,)
    for name in HEADER.split(","):
        np.testing.assert_allclose(table[name], getattr(recording, name), rtol=6e-9, atol=0)


def test_every_comparison_is_written_with_the_rule(tmp_path):
    found = dataclasses.replace(fake_diagnosis(), comparisons=(table(row(gains_fit=(0.123456789,)), row()),))
    found.save(tmp_path)
    content = strict((tmp_path / "comparisons.json").read_text(encoding="utf-8"))
    assert content["schema"] == "frictionjax.comparisons/1"
    assert content["rule"]["accept"]["least_share"] == found.rule.accept.least_share
    assert content["effort"]["rounds"] == found.effort.rounds
    (stored,) = map(table_of, content["tables"])
    assert stored.rows[0].gains_fit == (0.123457,)
    assert stored.rows[1] == found.comparisons[0].rows[1]


def test_an_earlier_result_is_replaced_and_other_files_are_left_alone(tmp_path):
    fake_diagnosis().save(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "fit" / "mine.csv").write_text("a,b\n1,2\n")
    adequate_diagnosis().save(tmp_path)
    assert set(listing(tmp_path)) == {
        *("notes.txt", "verdict.json", "comparisons.json", "report.html"),
        *("fit", "fit/mine.csv", "fit/only.csv"),
    }
    assert strict((tmp_path / "verdict.json").read_text())["case"] == "bench"


def test_a_recording_of_the_user_is_never_overwritten(tmp_path):
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "only.csv").write_text("t,u,x\n0,0,0\n")
    before = listing(tmp_path)
    with pytest.raises(InputError, match=r"only\.csv.*not written by frictionjax"):
        adequate_diagnosis().save(tmp_path)
    assert listing(tmp_path) == before


def test_the_report_stands_beside_the_numbers_unless_it_is_not_wanted(tmp_path):
    save_diagnosis(fake_diagnosis(), tmp_path / "deep" / "out")
    assert (tmp_path / "deep" / "out" / "report.html").read_text() == "<title>arm-2024-03</title>"
    save_diagnosis(fake_diagnosis(), tmp_path / "numbers", report=False)
    assert {path.name for path in (tmp_path / "numbers").iterdir()} == {
        "verdict.json",
        "comparisons.json",
        "fit",
    }


@pytest.mark.parametrize("existing", [False, True])
def test_a_failing_report_costs_the_report_alone(tmp_path, existing, monkeypatch):
    out = tmp_path / "deep" / "out"
    if existing:
        adequate_diagnosis().save(out)

    def writer(diagnosis, directory):
        (directory / "report.html").write_text("half")
        raise RuntimeError("no ink")

    monkeypatch.setattr(save, "write_report", writer)
    with pytest.warns(FrictionjaxWarning, match=r"report\.html is missing.*no ink"):
        fake_diagnosis().save(out)
    assert strict((out / "verdict.json").read_text(encoding="utf-8"))["case"] == "arm-2024-03"
    assert not (out / "report.html").exists()
    assert [path.name for path in tmp_path.rglob(".frictionjax*")] == []


@pytest.mark.parametrize("inside", ["", "out", "deep/out"])
def test_a_file_in_the_way_is_a_sentence(tmp_path, inside):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"file: is a file.*Choose another output directory") as caught:
        save_diagnosis(fake_diagnosis(), tmp_path / "file" / inside)
    assert "\n" not in str(caught.value)
    assert listing(tmp_path) == {"file": b"mine"}


def test_a_directory_where_a_file_is_to_go_is_a_sentence(tmp_path):
    (tmp_path / "verdict.json").mkdir()
    with pytest.raises(InputError, match="is a directory where a file is to go"):
        check_writable(tmp_path)


def test_checking_changes_nothing(tmp_path):
    check_writable(tmp_path / "deep" / "out")
    assert listing(tmp_path) == {}


def test_a_link_to_nothing_is_a_sentence(tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "nothing")
    for inside in ("out", "out/deep"):
        with pytest.raises(InputError, match=r"out: is a link to a folder that does not exist"):
            check_writable(tmp_path / inside)


def test_a_name_too_long_for_a_folder_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="too long for a name there, by 45 bytes"):
        check_writable(tmp_path / ("o" * 300) / "out")


def test_a_disk_without_room_for_the_result_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(save.shutil, "disk_usage", lambda path: types.SimpleNamespace(free=100_000))
    run = Recording("run", 1000.0, np.zeros(1000), np.zeros(1000))
    with pytest.raises(InputError, match=r"no room for the result, which takes 0\.176 MB"):
        check_writable(tmp_path, Case("bench", Plant(), (run,)))
    check_writable(tmp_path, Case("bench", Plant(), ()))


NAMES = (
    "a/b",
    "a\\b",
    "a_b",
    "A_B",
    "café",
    "cafe\u0301",
    "l" * 251,
    "l" * 300,
    "ö" * 200,
    "mo\udcffves",
    "..",
)


def test_names_that_no_two_files_can_have_get_files_of_their_own(tmp_path):
    files = fit_files(NAMES)
    assert len({unicodedata.normalize("NFC", file).casefold() for file in files.values()}) == len(NAMES)
    assert files["l" * 251] == "l" * 251 + ".csv"
    recordings = tuple(fake_recording(name, n=20, seed=k) for k, name in enumerate(NAMES))
    found = eqx.tree_at(lambda d: d.recordings, fake_diagnosis(n=20), recordings)
    found.save(tmp_path)
    verdict = strict((tmp_path / "verdict.json").read_text(encoding="utf-8"))
    for name, recording in zip(NAMES, recordings, strict=True):
        table = np.genfromtxt(tmp_path / verdict["fit"][name]["file"], delimiter=",", names=True)
        np.testing.assert_allclose(table["x"], recording.x, rtol=1e-8)
