"""Tests that the code in the notebook and in the Python documentation runs."""

import json
import os
import sysconfig
from pathlib import Path

import matplotlib
import pytest
import trilink

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    monkeypatch.setenv("PATH", path)
    return tmp_path


def test_the_notebook_makes_a_figure_from_trials(here):
    matplotlib.use("Agg")
    notebook = json.loads((DOCS / "own-figure.ipynb").read_text(encoding="utf-8"))
    names = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "outputs are not kept"
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    assert (here / "own-figure.svg").stat().st_size > 5000
    assert names["trials"].height == 5 and names["fitted"]["skid0_kg_s"] > 0


def test_the_code_in_the_python_documentation_runs(project, here, monkeypatch):
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    blocks = [rest.split("```")[0] for rest in text.split("```python\n")[1:]]
    assert len(blocks) == 3
    # The first block repeats a run and names a campaign that this project lacks, so `run` and `read` are replaced.
    monkeypatch.chdir(project[0])
    exec(blocks[1], {})
    monkeypatch.chdir(here)
    monkeypatch.setattr(trilink, "run", lambda path: None)
    monkeypatch.setattr(trilink, "read", lambda name: None)
    exec(blocks[0], {})
    exec(blocks[2], {})
