"""The friction of each joint of a six-joint arm: one table, a folder of reports, and the command."""

import dataclasses
import importlib
import json
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis
from helpers_six_joints import ARM, COULOMB, HIDDEN, JOINTS, NOISE, measured

from frictionjax.arm import diagnose_arm
from frictionjax.cli import main
from frictionjax.core import InputError
from frictionjax.diagnosis.screening import try_catalogue
from frictionjax.physics import catalogue
from frictionjax.report import save_arm_diagnosis
from frictionjax.report.arm_page import render_arm

pytest.importorskip("mujoco", minversion="4.0")

_HIDDEN = ("direction_asymmetry", "quadratic_drag", "position_dependence")
VERB = importlib.import_module("frictionjax.arm.diagnose_arm")
"""The module, whose name in the package is the verb's."""


def _stands_in(case, *, progress, **_):
    """In place of a diagnosis: one effect named in the lift, nothing elsewhere, and a roll that cannot be diagnosed."""
    progress("pretending", 0.5)
    if case.name == "roll":
        raise InputError("x moves too little", file=case.name)
    found = fake_diagnosis(n=400) if case.name == "lift" else adequate_diagnosis()
    return dataclasses.replace(found, case=case.name)


@pytest.fixture(scope="module")
def found():
    stages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(VERB, "diagnose", _stands_in)
        result = diagnose_arm(measured()[0], ARM, progress=lambda stage, part: stages.append((stage, part)))
    assert [stage for stage, _ in stages] == ["rigid bodies", *(f"{joint}: pretending" for joint in JOINTS)]
    assert [part for _, part in stages] == sorted(part for _, part in stages)
    return result


def test_the_joints_are_drawn_side_by_side(found):
    torque, error = found.plot()
    plt.close("all")
    rows = found.table()
    drawn = np.array([bar.get_width() for bar in torque.patches]).reshape(3, len(rows))
    for key, widths in zip(("torque", "left_as_given", "left_holdout"), drawn, strict=True):
        np.testing.assert_allclose(widths, [row[key] for row in rows])
    assert torque.get_xlabel() == "torque, rms (N·m)" and error.get_xscale() == "log"
    assert error.get_xlabel() == "force error 0.1 s ahead, held-out logs, rms (N·m)"
    said = [text.get_text() for text in error.get_yticklabels()]
    assert said[1] == "lift: maxwell slip" and said[4] == "roll: not diagnosed"
    base, extended = np.array([bar.get_width() for bar in error.patches]).reshape(2, len(rows))
    assert base[1] == rows[1]["error_base"] > extended[1] == rows[1]["error_extended"]
    assert np.isnan(np.delete(extended, 1)).all()  # without a named effect there is no extended model
    low = error.get_xlim()[0]
    assert low < np.nanmin([base, extended])


def test_one_table_over_the_joints(found):
    rows = found.table()
    assert [row["joint"] for row in rows] == list(JOINTS)
    assert [row["verdict"] for row in rows] == [
        *("adequate", "named", "adequate", "adequate", "not diagnosed", "adequate")
    ]
    lift, roll = rows[1], rows[4]
    assert lift["effects"] == "maxwell_slip" and "share = 0.42 ± 0.01" in lift["parameters"]
    assert lift["error_base"] == found["lift"].held_out_rmse()[0] > lift["error_extended"]
    assert np.isnan(rows[0]["error_base"])  # nothing of it was held out
    assert "moves too little" in roll["reason"] and np.isnan(roll["error_base"])
    assert "lift (maxwell_slip)" in found.summary and "Not diagnosed: roll" in found.summary
    with pytest.raises(KeyError):
        found["roll"]


def test_it_shows_itself(found):
    assert "Diagnosis of the arm log_1" in repr(found) and "maxwell_slip" in repr(found)
    assert "<td>not diagnosed</td>" in found._repr_html_()
    pytest.importorskip("pandas")
    assert found.to_dataframe().loc["lift", "effects"] == "maxwell_slip"
    assert len(found.to_dataframe("parameters")) == 40


class _Links(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name == "href" and tag == "a"]


def test_a_folder_with_a_page_of_links_to_each_report(found, tmp_path):
    folder = found.save(tmp_path / "out")
    page = (folder / "index.html").read_text(encoding="utf-8")
    reports = [link for link in _Links(page).links if link.endswith(".html")]
    assert reports == [f"joints/{joint}/report.html" for joint in JOINTS if joint != "roll"]
    assert all((folder / link).is_file() for link in reports)
    assert "maxwell_slip" in page and "moves too little" in page and "flange.mx" in page
    content = json.loads((folder / "arm.json").read_text(encoding="utf-8"))
    assert content["schema"] == "frictionjax.arm/1"
    assert [row["folder"] for row in content["joints"]][3:5] == ["joints/bend", None]
    assert content["joints"][4]["error_base"] is None
    assert content["base_parameters"]["tip.armature"]["value"] == pytest.approx(0.05, rel=0.1)
    found.save(folder)  # a second time, over the first


def test_names_of_joints_are_text(found):
    """Whatever a model calls its joints, the page holds no tags of it."""
    arm = dataclasses.replace(found.rigid_body.arm, joints=("<b>pan</b>", *JOINTS[1:]))
    joints = (dataclasses.replace(found.joints[0], joint="<b>pan</b>"), *found.joints[1:])
    other = dataclasses.replace(
        found, joints=joints, rigid_body=dataclasses.replace(found.rigid_body, arm=arm)
    )
    page = render_arm(other, {"<b>pan</b>": "joints/1"})
    assert "<b>" not in page and "&lt;b&gt;pan" in page


def test_a_page_of_others_is_not_overwritten(found, tmp_path):
    (tmp_path / "index.html").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="was not written by frictionjax"):
        save_arm_diagnosis(found, tmp_path)
    assert (tmp_path / "index.html").read_text(encoding="utf-8") == "mine"


def test_only_some_joints(monkeypatch):
    monkeypatch.setattr(VERB, "diagnose", _stands_in)
    with pytest.raises(InputError, match=r"no joint `lifd`\. Did you mean `lift`\?"):
        diagnose_arm(measured()[0], ARM, only=["lifd"])


def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(VERB, "diagnose", _stands_in)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(ARM, encoding="utf-8")
    for log in measured()[0]:
        t = np.arange(log.q.shape[0]) / log.sample_rate
        header = ",".join(
            ["t", *(f"{joint}.position" for joint in JOINTS), *(f"{joint}.effort" for joint in JOINTS)]
        )
        table = np.column_stack([t, log.q, log.tau])
        np.savetxt(f"{log.name}.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    logs = ["log_1.csv", "log_2.csv", "--holdout", "log_3.csv"]
    assert main(["arm", *logs, "--model", "arm.xml", "--only", "lift", "--out", "out"]) == 0
    printed = capsys.readouterr().out
    assert "lift (maxwell_slip)" in printed and "index.html" in printed
    assert (tmp_path / "out" / "joints" / "lift" / "verdict.json").is_file()
    assert main(["arm", *logs, "--model", "arm.xml", "--joints", "pan", "--out", "other"]) == 2
    assert "others were named: pan. Leave it out (--joints)" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "other").exists()


@pytest.mark.slow
def test_friction_hidden_in_three_joints_is_named(monkeypatch):
    """The whole, with five effects in place of the catalogue; of the elbow a map may be wanted beside its name."""
    whole = catalogue()
    few = {name: whole[name][:1] for name in (*_HIDDEN, "maxwell_slip", "stribeck_shape")}
    monkeypatch.setattr(try_catalogue, "catalogue", lambda: few)
    found = diagnose_arm(measured()[0], ARM, progress=False)
    for joint, row in zip(JOINTS, found.table(), strict=True):
        level = COULOMB[JOINTS.index(joint)]
        assert found[joint].extended["Fc"].value == pytest.approx(level, rel=0.05), joint
        if joint not in HIDDEN:
            assert (row["verdict"], row["effects"]) == ("adequate", ""), joint
        else:
            assert HIDDEN[joint].name in found[joint].missing[0].effect_class, joint
            assert row["error_extended"] < 2.0 * NOISE * level < 0.5 * row["error_base"], joint
