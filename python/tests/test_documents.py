"""Tests that the code in the notebook, in the Python documentation and in the docstrings runs, and that types agree."""

import doctest
import inspect
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import nbclient
import nbformat
import pytest
import trilink

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    monkeypatch.setenv("PATH", path)
    return tmp_path


@pytest.fixture
def copy(project, tmp_path, monkeypatch):
    """Changes to a copy of the project, which has been run."""
    folder = tmp_path / "copy"
    shutil.copytree(project[0], folder)
    monkeypatch.chdir(folder)
    trilink.run()
    return folder


def test_the_notebook_runs(here):
    notebook = nbformat.read(DOCS / "own-figure.ipynb", as_version=4)
    assert all(cell.get("outputs", []) == [] for cell in notebook.cells), "outputs are not kept"
    kernel = notebook.metadata.kernelspec.name
    done = nbclient.NotebookClient(
        notebook, timeout=300, kernel_name=kernel, resources={"metadata": {"path": str(here)}}
    ).execute()
    assert (here / "own-figure.svg").stat().st_size > 5000
    shown = [output for cell in done.cells for output in cell.get("outputs", [])]
    types = {kind for output in shown for kind in output.get("data", {})}
    assert {"text/html", "image/svg+xml"} <= types, "a table and a figure are shown"


def test_the_code_in_the_python_documentation_runs(copy):
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    blocks = [rest.split("```")[0] for rest in text.split("```python\n")[1:]]
    assert len(blocks) >= 5
    names = {}
    for block in blocks:
        exec(compile(block, "python.md", "exec"), names)


PUBLIC = [name for name in trilink.__all__ if callable(getattr(trilink, name))]


def test_every_function_has_an_example_that_runs(copy):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    finder = doctest.DocTestFinder(exclude_empty=False)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    found = [getattr(trilink, name) for name in PUBLIC] + [trilink.mocap.read]
    for one in found:
        for test in finder.find(one, one.__name__, globs={}):
            is_function = inspect.isroutine(getattr(one, test.name.split(".")[-1], one))
            assert test.examples or not is_function or "._" in test.name, test.name
            runner.run(test)
    assert runner.summarize(verbose=False).failed == 0


USE = """
import trilink

motion = trilink.simulate("kinematic-skewed", model="skid-roll", omega_rad_s=3.9)
reveal_type(motion.sigma)
several = trilink.simulate("kinematic-skewed", model="skid-roll", omega_rad_s=[3.9])
reveal_type(several)
motion.d_mm
trilink.optimise("kinematic-skewed", maximize="v")
"""


def test_types_pass_mypy(here):
    settings = Path(__file__).parents[1] / "pyproject.toml"
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", settings]
    checked = subprocess.run([*command, "-p", "trilink"], cwd=here, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout
    (here / "use.py").write_text(USE)
    found = subprocess.run([*command, "use.py"], cwd=here, capture_output=True, text=True).stdout
    assert "builtins.tuple[builtins.float, ...]" in found or "tuple[float, ...]" in found, found
    assert re.search(r"list\[trilink\._results\.Motion\]", found), found
    assert '"Motion" has no attribute "d_mm"' in found and '"maximize"' in found, found
    assert "Found 2 errors" in found, found
