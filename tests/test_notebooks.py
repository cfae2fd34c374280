"""The notebooks: committed without outputs, and executed in their small setting."""

import json
import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from helpers_diagnosis import fake_diagnosis
from nbclient import NotebookClient

import frictionjax as fj

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_is_the_paper():
    assert "01_the_paper.ipynb" in [path.name for path in NOTEBOOKS]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_without_outputs(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 3
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_in_its_small_setting(path, monkeypatch):
    monkeypatch.setenv("FRICTIONJAX_SMALL", "1")
    # As a user's kernel starts: without the strictness of this test session.
    for name in ("JAX_ENABLE_X64", "XLA_FLAGS", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()
    printed = "".join(
        output.get("text", "")
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output.output_type == "stream"
    )
    assert "Traceback" not in printed
    if path.stem == "01_the_paper":
        assert "50.329 Hz" in printed
        assert "softening bristle" in printed
        images = sum("image/png" in o.get("data", {}) for c in notebook.cells for o in c.get("outputs", []))
        assert images >= 4


REAL = FOLDER.parents[1] / "shared" / "real"


def test_the_real_machines_are_reported_and_drawn(monkeypatch, capsys):
    """What the notebook does with a diagnosis, where its data are absent."""
    cells = nbformat.read(FOLDER / "03_real_machines.ipynb", as_version=4).cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    helpers = next(source for source in code if "def draw" in source)
    monkeypatch.setattr(plt, "show", lambda: None)
    names: dict = {"fj": fj, "np": np, "plt": plt, "load_machine": None, "SMALL": True}
    exec(helpers, names)
    found = fake_diagnosis()
    names["summarise"](found)
    before, after = found.held_out_rmse()
    assert f"0.1 s ahead: {before:.3g} -> {after:.3g} rad" in capsys.readouterr().out
    names["draw"](found)
    left, right = plt.gcf().axes
    drawn = [patch.get_width() for patch in left.patches]
    assert max(drawn) == max(b.excess for b in found.mismatch if b.axis in ("regime", "direction"))
    assert right.get_ylabel() == "residual force (N*m)"
    plt.close()


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason="the recordings are not beside the repository")
def test_the_real_machines_run_whole(monkeypatch):
    for name in ("JAX_ENABLE_X64", "XLA_FLAGS", "MPLBACKEND", "FRICTIONJAX_SMALL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("FRICTIONJAX_DATA", str(REAL))
    notebook = nbformat.read(FOLDER / "03_real_machines.ipynb", as_version=4)
    NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    stated = "".join(output.get("text", "") for output in outputs if output.output_type == "stream")
    images = sum("image/png" in output.get("data", {}) for output in outputs)
    assert images >= stated.count("Known of ") > 0
