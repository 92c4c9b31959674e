"""Processes motion-capture trials of a three-link robot: from marker files to fitted dissipation models and figures.

    import polars, trilink

    summary = trilink.run("pipeline.toml")
    trials = polars.DataFrame(trilink.read("trials"))
    motion = trilink.simulate("kinematic-symmetric", model="skid-roll", omega_rad_s=3.9, samples=240)

Names of quantities end with the unit: `_m`, `_m_s`, `_rad`, `_rad_s`, `_kg_s`, `_n`, `_j`, `_s`. Functions that fail
raise an `Error` with the same message as the command-line program `trilink`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

from . import _trilink
from ._trilink import BusyError, ConfigError, Error, TableError, __version__

if TYPE_CHECKING:
    import numpy

    Path = str | os.PathLike[str]
    Number = float | Sequence[float]

__all__ = [
    "BusyError",
    "ConfigError",
    "Error",
    "Table",
    "TableError",
    "__version__",
    "read",
    "run",
    "simulate",
]


def run(
    config: Path | None = None,
    *,
    folders: Iterable[Path] | None = None,
    only: bool = False,
    force: bool = False,
    verify: bool = False,
    wait: bool = False,
    progress: bool | None = None,
) -> dict[str, Any]:
    """Ingests trials, fits models and writes the report, like `trilink run`; recomputes only what is out of date.

    config: path of a `pipeline.toml`; by default, the one in the current folder or, if there is none, the values of
        the paper.
    folders: trial folders, or patterns that match them, to be used instead of the configured ones.
    only: remove the results of trials in all other folders; by default, these results are kept.
    force: recompute every trial, fit and figure, even if it is up to date.
    verify: read every file again, even if its size and time have not changed.
    wait: wait until another run on the same results has ended, instead of raising `BusyError`.
    progress: show the progress on `sys.stderr`: as a progress bar on a terminal, or otherwise (for example, in a
        notebook) as one line for each trial, fit and figure. By default, progress is shown on terminals only.

    Returns a dictionary with these keys: `was_up_to_date`, whether nothing had to be recomputed; `needs_a_person`,
    whether the exit status of the program would be 1; `results`, with the number of `trials` by status, the trials
    that need `attention`, the status of each of the `fits` and the path of the report `page` (as in
    `reports/run.json`); `stages`, with their durations in `seconds`; `derived`, the folder from which `read` reads
    tables; `history_problem`, the problem with the history of runs or None; and `damaged`, sentences about damaged
    tables.

    Raises ConfigError, TableError, BusyError or Error if the run fails. Ctrl-C stops the run between two steps with a
    KeyboardInterrupt that describes the progress; all files remain intact.
    """
    is_terminal = getattr(sys.stderr, "isatty", lambda: False)()
    shown = is_terminal if progress is None else progress
    request = {
        "config": _path(config),
        "folders": None if folders is None else [_path(folder) for folder in folders],
        "only": only,
        "force": force,
        "verify": verify,
        "wait": wait,
        "progress": ("bars" if is_terminal else "lines") if shown else None,
    }
    return json.loads(_trilink.run(json.dumps(request)))


def read(
    table: Path,
    *,
    folder: Path | None = None,
    config: Path | None = None,
    columns: Iterable[str] = (),
    where: str | None = None,
) -> Table:
    """Reads a table from the folder `derived`, or any Parquet file.

    table: name of the table, such as `trials`, `fits` or `poses/kinematic-symmetric-3.90-r1`, or path of a file.
    folder: folder that contains the tables; by default, `paths.derived` in the configuration.
    config: path of the `pipeline.toml`, as for `run`.
    columns: names of the columns to read; by default, all columns.
    where: SQL condition that selects rows, such as "campaign = 'x' and omega_rad_s > 3".

    Raises TableError if the table or a column does not exist, or if the condition is invalid.
    """
    request = {
        "table": _path(table),
        "folder": _path(folder),
        "config": _path(config),
        "columns": [columns] if isinstance(columns, str) else list(columns),
        "condition": where,
    }
    return Table(*_trilink.read(json.dumps(request)))


class Table:
    """Table in memory, which polars, pandas, DuckDB and pyarrow can use without copying the data.

    trials = trilink.read("trials")
    polars.DataFrame(trials)
    pandas.DataFrame.from_arrow(trials)
    duckdb.sql("from trials")
    pyarrow.table(trials)
    """

    def __init__(self, path: str, columns: str, rows: int, stream: Any) -> None:
        self.path: str = path
        """Path of the file from which the table was read."""
        described = json.loads(columns)
        self.columns: list[str] = [column["name"] for column in described]
        """Names of the columns, including the units."""
        self.units: dict[str, str | None] = {column["name"]: column["unit"] for column in described}
        """Units by column name, such as `m/s`; None for columns without a unit."""
        self.meanings: dict[str, str | None] = {
            column["name"]: column["meaning"] for column in described
        }
        """Descriptions by column name; None for columns that trilink does not define."""
        self._rows = rows
        self._stream = stream

    def __len__(self) -> int:
        """Returns the number of rows."""
        return self._rows

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Returns a PyCapsule with an Arrow stream of the table. `requested_schema` is ignored."""
        return self._stream()

    def __repr__(self) -> str:
        return f"<trilink.Table {self.path}: {self._rows} rows, {len(self.columns)} columns>"


@overload
def simulate(
    campaign: str | None = ...,
    *,
    model: str,
    omega_rad_s: float,
    robot: str | Mapping[str, Any] | None = ...,
    gait: str | Mapping[str, Any] | None = ...,
    config: Path | None = ...,
    from_rest: bool = ...,
    samples: int | None = ...,
    **parameters: Number,
) -> dict[str, Any]: ...
@overload
def simulate(
    campaign: str | None = ...,
    *,
    model: str,
    omega_rad_s: Sequence[float] | numpy.ndarray,
    robot: str | Mapping[str, Any] | None = ...,
    gait: str | Mapping[str, Any] | None = ...,
    config: Path | None = ...,
    from_rest: bool = ...,
    samples: int | None = ...,
    **parameters: Number,
) -> list[dict[str, Any]]: ...
def simulate(
    campaign: str | None = None,
    *,
    model: str,
    omega_rad_s: float | Sequence[float] | numpy.ndarray,
    robot: str | Mapping[str, Any] | None = None,
    gait: str | Mapping[str, Any] | None = None,
    config: Path | None = None,
    from_rest: bool = False,
    samples: int | None = None,
    **parameters: Number,
) -> dict[str, Any] | list[dict[str, Any]]:
    """Solves for a model's steady-state motion, like `trilink simulate --json`.

    campaign: name of a `[campaign.*]` in the configuration, which defines the robot and the gait.
    robot, gait: alternatives to `campaign`, or replacements for its robot or gait: names of a `[robot.*]` and a
        `[gait.*]` in the configuration, or the contents of such tables, for example
        gait={"joint1": {"amplitude_deg": 30}, "joint2": {"amplitude_deg": 30, "phase_deg": 90}}.
    model: name of a model: no-skid, skid, skid-roll, coulomb, ... or a `[model.*]` in the configuration.
    omega_rad_s: one or several frequencies, rad/s.
    config: path of a `pipeline.toml`; by default, the one in the current folder or, if there is none, the values of
        the paper.
    from_rest: return the attractor that the robot reaches from rest.
    samples: add the `trajectory` of one steady-state cycle, divided into this number of intervals, 8 to 100000; with
        `from_rest`, the trajectory covers all cycles from rest to the steady state and one more.
    parameters: values that replace parameters of the robot, such as skid_kg_s=[104, 34, 45] or, for one wheel,
        skid1_kg_s=34, or of the commanded joints, such as amplitude1_deg=25.

    Returns a dictionary (for several frequencies, a list with one dictionary per frequency) with these keys: `d_m`
    (displacement per cycle), `v_m_s` (mean speed), `sigma` (skid ratios), `alpha1_rad` (amplitude of a passive joint),
    `dtheta_rad` (rotation per cycle), `work_j` (work of the actuators per cycle), `work_j_m` (work per metre),
    `cost_of_transport` (work over weight and displacement), `status` (kind of motion), `floquet` (modulus of the
    largest Floquet multiplier), `from_rest`, `cycles_to_settle`, `sharp_limit` (for dry friction), `model`,
    `parameters` (of the robot) and `gait`. If the motion does not exist, `reason` says why, and the values are None.
    With `samples`, `trajectory` is a dictionary of NumPy arrays named like the numeric columns of `trilink simulate
    --trajectory`: `time_s`, `x_m`, `phi1_rad`, `skid0_m_s`, ... (NaN for missing values); it is None if the motion does
    not exist.

    Raises ConfigError if the campaign, the model or a parameter does not exist.
    """
    if samples is not None and not 8 <= samples <= 100_000:
        raise ConfigError(f"samples: found {samples}, needed 8 to 100000")
    omegas = getattr(omega_rad_s, "tolist", lambda: omega_rad_s)()
    is_one = isinstance(omegas, (int, float))
    request = {
        "config": _path(config),
        "campaign": campaign,
        "robot": robot if robot is None or isinstance(robot, str) else dict(robot),
        "gait": gait if gait is None or isinstance(gait, str) else dict(gait),
        "model": model,
        "omegas_rad_s": [omegas] if is_one else list(omegas),
        "settings": [f"{key}={_setting(value)}" for key, value in parameters.items()],
        "from_rest": from_rest,
        "samples": samples,
    }
    text, trajectories = _trilink.simulate(json.dumps(request, default=_plain))
    answers = json.loads(text)
    for answer, trajectory in zip(answers, trajectories):
        answer["trajectory"] = None if trajectory is None else _arrays(*trajectory)
    return answers[0] if is_one else answers


def _arrays(names: list[str], data: bytearray) -> dict[str, numpy.ndarray]:
    import numpy

    values = numpy.frombuffer(data).reshape(len(names), -1)
    return dict(zip(names, values))


def _setting(value: Number) -> str:
    value = _plain(value)
    parts = [value] if isinstance(value, (int, float)) else value
    return ",".join(repr(float(part)) for part in parts)


def _plain(value: Any) -> Any:
    """Converts NumPy numbers and arrays to Python numbers and lists."""
    return value.tolist() if hasattr(value, "tolist") else value


def _path(path: Path | None) -> str | None:
    return None if path is None else os.fspath(path)


def _main() -> int:
    """Runs the command `trilink` and returns its exit status."""
    import signal

    # The program handles Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _trilink.main(sys.argv)
