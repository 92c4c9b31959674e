"""From marker files of a wheeled three-link robot to fitted dissipation models and figures.

    import polars, trilink

    summary = trilink.run("pipeline.toml")
    trials = polars.DataFrame(trilink.read("trials"))
    motion = trilink.simulate("kinematic-symmetric", model="skid-roll", omega_rad_s=3.9, samples=240)

Units are in the names: `_m`, `_m_s`, `_rad`, `_rad_s`, `_kg_s`, `_n`, `_j`, `_s`. What a function cannot do
is an `Error` in the program's words. The program itself is the command `trilink`.
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
    """Ingests, fits and reports what has changed, as `trilink run` does.

    config: path of a `pipeline.toml`; without one that of the current folder, or the paper's values.
    folders: trial folders, or patterns of them, instead of the configured ones.
    only: remove the trials of all other folders, which otherwise stay.
    force: redo every trial, fit and figure, not only what changed.
    verify: read every file again, also those whose size and time have not changed.
    wait: wait for another run on the same results, instead of a `BusyError`.
    progress: show on `sys.stderr` what is done, by a bar on a terminal and elsewhere, as in a notebook, by a
        line for each trial, fit and figure; without a word only on a terminal.

    Gives `was_up_to_date`; `needs_a_person`, true where the program's exit status is 1; `results`, how
    many `trials` ended how, which need `attention`, how each of the `fits` ended, the path of the
    `page` (as in `reports/run.json`); `stages` with their times, `seconds`; `derived`, where the
    tables are, for `read`; `history_problem` and what was `damaged`.

    Raises ConfigError, TableError, BusyError or Error where nothing could be done. Ctrl-C stops it
    between two steps, as a KeyboardInterrupt that says how far it was; every file is whole.
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
    """Reads a table of `derived`, or any Parquet file.

    table: its name, such as `trials`, `fits` or `poses/kinematic-symmetric-3.90-r1`, or a path.
    folder: where the tables are; without one the configuration's `paths.derived`.
    config: path of that `pipeline.toml`, as for `run`.
    columns: those to read; all without any.
    where: a condition as SQL has it: "campaign = 'x' and omega_rad_s > 3".

    Raises TableError where there is no such table, column or condition.
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
    """A table in memory, which polars, pandas, DuckDB and pyarrow take as it is, without a copy.

    trials = trilink.read("trials")
    polars.DataFrame(trials)
    pandas.DataFrame.from_arrow(trials)
    duckdb.sql("from trials")
    pyarrow.table(trials)
    """

    def __init__(self, path: str, columns: str, rows: int, stream: Any) -> None:
        self.path: str = path
        """The file that it was read from."""
        described = json.loads(columns)
        self.columns: list[str] = [column["name"] for column in described]
        """Names of the columns, units in them."""
        self.units: dict[str, str | None] = {of["name"]: of["unit"] for of in described}
        """The columns' units, such as `m/s`; None of what has none."""
        self.meanings: dict[str, str | None] = {of["name"]: of["meaning"] for of in described}
        """What the columns mean; None of columns that are not trilink's."""
        self._rows = rows
        self._stream = stream

    def __len__(self) -> int:
        """Number of rows."""
        return self._rows

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """A PyCapsule of an Arrow stream (the types are the table's own, whatever is requested)."""
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
    """Solves for a model's steady motion, as `trilink simulate --json` does.

    campaign: name of a `[campaign.*]` of the configuration, which has a robot and a gait; or say
    robot, gait: names of `[robot.*]` and `[gait.*]`, or what these tables say:
        gait={"joint1": {"amplitude_deg": 30}, "joint2": {"amplitude_deg": 30, "phase_deg": 90}}.
    model: name of a `[model.*]`: no-skid, skid, skid-roll, coulomb, .. or one of the configuration.
    omega_rad_s: a frequency, rad/s, or several.
    config: path of a `pipeline.toml`; without one that of the current folder, or the paper's values.
    from_rest: answer with the motion in which the robot ends that starts from rest.
    samples: add one steady cycle at so many moments and one more, 8 to 100000 a cycle; with
        `from_rest` the way there.
    parameters: of the robot: skid_kg_s=[104, 34, 45], of one wheel skid1_kg_s=34; and of the gait, of a
        commanded joint: amplitude1_deg=25.

    Gives for each frequency a dictionary: `d_m` (displacement a cycle), `v_m_s`, skid ratios `sigma`,
    `alpha1_rad` (amplitude of a passive joint), `dtheta_rad` (rotation a cycle), `work_j` (of the
    actuators, a cycle), `work_j_m`, the motion's `status`, the modulus of the largest Floquet
    multiplier `floquet`, `from_rest`, `cycles_to_settle`, of dry friction `sharp_limit`, the `model`, the
    robot's `parameters` and the `gait`. A motion that does not exist has a `reason`, and None for numbers. With `samples`
    there is `trajectory`, NumPy arrays by the names that `trilink simulate --trajectory` gives its
    columns of numbers: `time_s`, `x_m`, `phi1_rad`, `skid0_m_s`, .. (NaN where there is no value), or None.

    Raises ConfigError where there is no such campaign, model or parameter.
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
    """NumPy's numbers and arrays as Python's own."""
    return value.tolist() if hasattr(value, "tolist") else value


def _path(path: Path | None) -> str | None:
    return None if path is None else os.fspath(path)


def _main() -> int:
    """The command `trilink`."""
    import signal

    # The program listens for Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _trilink.main(sys.argv)
