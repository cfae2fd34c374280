"""The notebooks: committed without outputs, and executed in their small setting."""

import json
import os
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

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
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
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
