import os
import subprocess
import sysconfig
from pathlib import Path

import pytest
import trilink

# The program wraps its messages at the width that readline, which pytest imports, exports.
os.unsetenv("COLUMNS")

CONFIG = """
[fit]
starts = 2
bootstrap = 40

[campaign.kinematic-skewed]
robot = "kinematic"
gait = "skewed"
models = ["skid", "skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }
"""


@pytest.fixture(scope="session")
def program():
    """Returns the path of the command `trilink` that the wheel installs."""
    return Path(sysconfig.get_path("scripts")) / ("trilink.exe" if os.name == "nt" else "trilink")


@pytest.fixture(scope="session")
def empty(tmp_path_factory, program):
    """Creates a project with one campaign of synthetic trials at five frequencies, which has not been run."""
    folder = tmp_path_factory.mktemp("empty")
    (folder / "pipeline.toml").write_text(CONFIG)
    synth = [program, "synth", "raw/demo", "--omega", "1,2,3,3.9,5", "--quiet"]
    subprocess.run(synth, cwd=folder, check=True)
    return folder


@pytest.fixture(scope="session")
def project(empty, tmp_path_factory):
    """Returns the folder of a copy of the project `empty` after a run, and the result of `trilink.run`."""
    import shutil

    folder = tmp_path_factory.mktemp("project") / "small"
    shutil.copytree(empty, folder)
    return folder, trilink.run(folder / "pipeline.toml")
