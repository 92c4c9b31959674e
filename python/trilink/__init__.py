"""Processes motion-capture trials of a three-link robot: from marker files to fitted dissipation models and figures.

    import trilink

    done = trilink.run("pipeline.toml")
    trials = trilink.read("trials").to_polars()
    motion = trilink.simulate("kinematic-symmetric", omega_rad_s=3.9, fitted=True, samples=240)

Names of quantities end with the unit: `_m`, `_m_s`, `_rad`, `_rad_s`, `_kg_s`, `_n`, `_j`, `_s`. Functions that fail
raise an `Error` with the message of the command-line program `trilink`, in which arguments take the place of options;
an invalid argument is a `ValueError`, too. Ctrl-C stops every function with a `KeyboardInterrupt`.
"""

import sys

from . import _trilink, mocap
from ._commands import (
    branches,
    check,
    compare,
    design,
    fit,
    init,
    optimise,
    read,
    report,
    run,
    sensitivities,
)
from ._errors import BusyError, Caution, ConfigError, Error, TableError
from ._figure import Figure
from ._objective import Objective
from ._results import Motion
from ._simulate import simulate
from ._table import Table
from ._trilink import __version__

__all__ = [
    "BusyError",
    "Caution",
    "ConfigError",
    "Error",
    "Figure",
    "Motion",
    "Objective",
    "Table",
    "TableError",
    "__version__",
    "branches",
    "check",
    "compare",
    "design",
    "fit",
    "init",
    "mocap",
    "optimise",
    "read",
    "report",
    "run",
    "sensitivities",
    "simulate",
]


def _main() -> int:
    """Runs the command `trilink` and returns its exit status."""
    import signal

    # The program handles Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _trilink.main(sys.argv)
