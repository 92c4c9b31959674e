"""The notebook and the page run."""

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


def test_the_notebook_goes_from_trials_to_a_figure(here):
    matplotlib.use("Agg")
    notebook = json.loads((DOCS / "own-figure.ipynb").read_text(encoding="utf-8"))
    names = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "outputs are not kept"
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    assert (here / "own-figure.svg").stat().st_size > 5000
    assert names["trials"].height == 5 and names["fitted"]["skid0_kg_s"] > 0


def test_the_page_s_python_runs(project, here, monkeypatch):
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    blocks = [rest.split("```")[0] for rest in text.split("```python\n")[1:]]
    assert len(blocks) == 3
    # Of the first one the run is done, and its campaign is not this project's.
    monkeypatch.chdir(project[0])
    exec(blocks[1], {})
    monkeypatch.chdir(here)
    monkeypatch.setattr(trilink, "run", lambda path: None)
    monkeypatch.setattr(trilink, "read", lambda name: None)
    exec(blocks[0], {})
    exec(blocks[2], {})
