import os
import subprocess
import sysconfig
from pathlib import Path

import pytest
import trilink

CONFIG = """
[fit]
starts = 1
bootstrap = 20
gait_input = "commanded"

[campaign.small]
robot = "kinematic"
gait = "symmetric"
models = ["no-skid", "skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 0.2, alpha = 0.0 }
"""


# Readline, which pytest imports, sets this variable; the program would wrap its messages by it.
os.environ.pop("COLUMNS", None)


@pytest.fixture(scope="session")
def program():
    """Returns the path of the command `trilink` that the wheel installs."""
    return Path(sysconfig.get_path("scripts")) / ("trilink.exe" if os.name == "nt" else "trilink")


@pytest.fixture(scope="session")
def empty(tmp_path_factory, program):
    """Creates a project with one campaign of synthetic trials at three frequencies, which has not been run."""
    folder = tmp_path_factory.mktemp("empty")
    (folder / "pipeline.toml").write_text(CONFIG)
    synth = [program, "synth", "raw/demo", "--omega", "2,3,3.9", "--quiet"]
    subprocess.run(synth, cwd=folder, check=True)
    return folder


@pytest.fixture(scope="session")
def project(empty, tmp_path_factory):
    """Returns the folder of a copy of the project `empty` after a run, and the result of `trilink.run`."""
    import shutil

    folder = tmp_path_factory.mktemp("project") / "small"
    shutil.copytree(empty, folder)
    return folder, trilink.run(folder / "pipeline.toml")
