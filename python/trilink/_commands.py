"""The commands of the program as functions."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from . import _trilink
from ._call import Numbers, Pathlike, Returned, call, from_json, interval, list_from_json, numbers
from ._figure import Figure
from ._results import (
    Branches,
    Check,
    CheckedFile,
    CheckedTrial,
    Comparison,
    Design,
    Fits,
    Init,
    Optima,
    Report,
    Run,
    Sensitivities,
)
from ._table import Table

Texts = str | Iterable[str]


def init(
    *folders: Pathlike,
    out: Pathlike | None = None,
    l_m: float | None = None,
    front: str | None = None,
    unit: str = "mm",
    add: bool = False,
    force: bool = False,
    progress: bool | None = None,
) -> Init:
    """Writes a first `pipeline.toml` and `trials.toml` from marker files alone, like `trilink init`.

    folders: folders of marker files.
    out: folder for `pipeline.toml`; by default, the current one. Each list of trials is written next to its files.
    l_m: distance from joint to wheel of the side links, m; by default, it is estimated.
    front: label of a marker on the front link; by default, the front link is found from the markers.
    unit: unit of length in files that do not state one: mm, cm, m or in.
    add: add the robot of these folders to an existing `pipeline.toml`.
    force: replace existing files.

    >>> import shutil, trilink
    >>> recordings = shutil.copytree("raw/demo", "new/recordings")
    >>> found = trilink.init(recordings, out="new", force=True)
    >>> found.robot, found.campaigns[0].files, [path.name for path in found.written]
    ('snake', 5, ['pipeline.toml', 'trials.toml'])
    """
    done = call(
        "init",
        *folders,
        out=out,
        l_m=l_m,
        front=front,
        unit=unit,
        add=add,
        force=force,
        json=True,
        progress=progress,
    )
    return from_json(Init, done.json, needs_attention=done.needs_attention)


def check(*paths: Pathlike, config: Pathlike | None = None, progress: bool | None = None) -> Check:
    """Checks trial folders or marker files without writing anything, like `trilink check`.

    paths: trial folders, patterns that match trial folders, or marker files; by default, the configured folders.
    config: path of a `pipeline.toml`; by default, the one in the current folder or, if there is none, the values of
        the paper.

    >>> import trilink
    >>> checked = trilink.check()
    >>> len(checked.trials), checked.trials[0].status, checked.needs_attention
    (6, 'ok', False)
    >>> [file] = trilink.check("raw/demo/kinematic-skewed-2.00-r1.csv").files
    >>> file.recording.rate_hz, file.stops
    (120.0, [])
    """
    done = call("check", *paths, config=config, json=True, progress=progress)
    is_of_files = bool(paths) and all(os.path.isfile(path) for path in paths)
    trials = [] if is_of_files else list_from_json(CheckedTrial, done.json)
    files = list_from_json(CheckedFile, done.json) if is_of_files else []
    return Check(trials, files, done.needs_attention)


def run(
    config: Pathlike | None = None,
    *,
    folders: Iterable[Pathlike] = (),
    only: bool = False,
    force: bool = False,
    verify: bool = False,
    wait: bool = False,
    progress: bool | None = None,
) -> Run:
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

    Ctrl-C stops the run between two steps with a `KeyboardInterrupt` that describes the progress; all files remain
    intact.

    >>> import trilink
    >>> done = trilink.run("pipeline.toml")
    >>> done.results.trials.ok, done.results.fits[1].model, done.needs_attention
    (6, 'skid-roll', False)
    """
    done = call(
        "run",
        *folders,
        config=config,
        only=only,
        force=force,
        verify=verify,
        wait=wait,
        progress=progress,
    )
    return from_json(Run, done.json, needs_attention=done.needs_attention)


def fit(
    config: Pathlike | None = None,
    *,
    trials: Pathlike | None = None,
    into: Pathlike | None = None,
    wait: bool = False,
    progress: bool | None = None,
) -> Fits:
    """Fits every model of every campaign to the ingested trials, like `trilink fit`.

    config, wait, progress: as for `run`.
    trials: fit the trials of this CSV or Parquet table of another program instead, and write the tables to `into`.
    into: folder for the tables, with `trials`.

    >>> import trilink
    >>> fits = trilink.fit().fits
    >>> fits["model"].tolist(), fits["adequate"].tolist()
    (['skid', 'skid-roll'], [False, True])
    """
    done = call("fit", config=config, trials=trials, into=into, wait=wait, progress=progress)
    fits, comparison = (read(name, config=config, folder=into) for name in ("fits", "comparison"))
    return Fits(fits, comparison, done.needs_attention)


def report(
    config: Pathlike | None = None,
    *,
    trial: Texts | None = None,
    wait: bool = False,
    progress: bool | None = None,
) -> Report:
    """Draws the figures and writes the report page, like `trilink report`; returns the figures.

    config, wait, progress: as for `run`.
    trial: names of trials that get a page of their own, even if there are more than `report.trial_pages`.

    >>> import trilink
    >>> drawn = trilink.report()
    >>> drawn.page.name, drawn.figures["work"]
    ('index.html', <trilink.Figure work>)
    """
    done = call("report", config=config, trial=trial, wait=wait, progress=progress)
    drawn = from_json(_Drawn, done.json)
    folder = drawn.page.parent / "figures"
    figures = {name: Figure(folder / f"{name}.svg", is_of_report=True) for name in drawn.figures}
    return Report(drawn.page, figures, drawn.missing)


def compare(
    baseline: Pathlike | None = None,
    *,
    against: Pathlike | None = None,
    tolerance: Texts | None = None,
    save: Pathlike | None = None,
    accept: str | None = None,
    max_age: str | None = None,
    config: Pathlike | None = None,
    wait: bool = False,
) -> Comparison | None:
    """Compares the tables with those of an earlier run, like `trilink compare`; None if `save` is given alone.

    baseline: file that `save` or `accept` wrote, or a folder of tables; by default, `paths.baseline`.
    against: folder of tables to compare with the baseline; by default, `paths.derived`.
    tolerance: tolerances that override those of the configuration, such as "trials.d_m = { absolute = 0.001 }".
    save: file to which a summary of the tables is saved for later comparisons.
    accept: make the tables the new (or first) baseline, and record this reason.
    max_age: maximum time since the last run, such as "20h", "90min" or "2d".
    config, wait: as for `run`.

    >>> import trilink
    >>> trilink.compare(save="earlier.json")
    >>> compared = trilink.compare("earlier.json")
    >>> compared.within_tolerance, compared.differences
    (True, [])
    """
    done = call(
        "compare",
        *([] if baseline is None else [baseline]),
        against=against,
        tolerance=tolerance,
        save=save,
        accept=accept,
        max_age=max_age,
        config=config,
        wait=wait,
        json=True,
    )
    return from_json(Comparison, done.json) if done.json else None


def read(
    table: Pathlike,
    *,
    folder: Pathlike | None = None,
    config: Pathlike | None = None,
    columns: Texts = (),
    where: str | None = None,
) -> Table:
    """Reads a table from the folder `derived`, or any Parquet file, like `trilink inspect`.

    table: name of the table, such as `trials`, `fits` or `poses/kinematic-symmetric-3.90-r1`, or path of a file.
    folder: folder that contains the tables; by default, `paths.derived` in the configuration.
    config: path of the `pipeline.toml`, as for `run`.
    columns: names of the columns to read; by default, all columns.
    where: SQL condition that selects rows.

    >>> import trilink
    >>> trilink.read("trials", columns=["trial", "d_m"], where="omega_rad_s > 3.5")["trial"].tolist()
    ['kinematic-skewed-3.90-r1', 'kinematic-skewed-5.00-r1']
    """
    names = [columns] if isinstance(columns, str) else list(columns)
    path, access = _trilink.read(
        os.fspath(table), path_text(folder), path_text(config), names, where
    )
    return Table(access, path)


def optimise(
    campaign: str,
    *,
    maximise: str | None = None,
    minimise: str | None = None,
    pareto: Texts | None = None,
    model: str | None = None,
    fitted: bool = False,
    replicates: int | None = None,
    free: Texts | None = None,
    harmonics: Literal[1, 2] = 1,
    omega_rad_s: float | tuple[float, float] | None = None,
    amplitude_deg: float | tuple[float, float] | None = None,
    rotor_amplitude_deg: float | tuple[float, float] | None = None,
    angle_deg: float | None = None,
    rate_deg_s: float | None = None,
    power_w: float | None = None,
    torque_nm: float | None = None,
    least: tuple[str, float] | None = None,
    starts: int | None = None,
    figure: bool = False,
    keep: bool = False,
    config: Pathlike | None = None,
    wait: bool = False,
    **parameters: Numbers,
) -> Optima:
    """Optimises a gait for distance, speed or work, as predicted by a model, like `trilink optimise`.

    campaign: name of a `[campaign.*]`, whose robot and gait are the starting point.
    maximise: d, v, d-per-work or v-per-power. minimise: work-per-metre.
    pareto: the other objective, or both objectives, of a Pareto front.
    model: name of a model; with `fitted`, by default the preferred model of the comparison.
    fitted: use the coefficients that were fitted to the campaign's trials.
    replicates: number of bootstrap replicates for confidence intervals of the optimum; 0 for none.
    free: commands to vary, such as omega, amplitude1, offset2, phase2; by default, all but the second harmonics.
    harmonics: 2 also varies the second harmonics of the joints that vary.
    omega_rad_s, amplitude_deg, rotor_amplitude_deg: bounds (low, high), or a number that fixes the frequency or the
        amplitudes of the joints or rotors.
    angle_deg, rate_deg_s, power_w, torque_nm: maximum joint angle, joint rate, mean power and torque.
    least: another objective and its worst permitted value, such as ("v", 0.05).
    starts: number of starts of the search.
    figure: also draw the objective around the optimum, or the Pareto front.
    keep: save the optima to the tables, for the report.
    config, wait: as for `run`.
    parameters: values that replace parameters of the robot or the gait, as for `simulate`.

    >>> import trilink
    >>> best = trilink.optimise(
    ...     "kinematic-skewed", maximise="v", fitted=True, replicates=0, free="phase2", omega_rad_s=3.9
    ... )
    >>> best.is_usable, bool(best.optima["v_m_s"][0] > 0.05)
    (True, True)
    """
    done, drawn = _draw(
        figure,
        lambda file: call(
            "optimise",
            campaign,
            config=config,
            settings=parameters,
            maximise=maximise,
            minimise=minimise,
            pareto=pareto,
            model=model,
            fitted=fitted,
            replicates=replicates,
            free=free,
            harmonics=harmonics,
            omega=interval(omega_rad_s),
            amplitude_deg=interval(amplitude_deg),
            rotor_amplitude_deg=interval(rotor_amplitude_deg),
            angle_deg=angle_deg,
            rate_deg_s=rate_deg_s,
            power_w=power_w,
            torque_nm=torque_nm,
            least=None if least is None else f"{least[0]}={numbers(least[1])}",
            starts=starts,
            figure=file,
            keep=keep,
            wait=wait,
        ),
        "optimum",
    )
    return Optima(done.tables["rows"], not done.needs_attention, drawn)


def branches(
    campaign: str,
    *,
    over: tuple[str, float, float],
    model: str | None = None,
    fitted: bool = False,
    omega_rad_s: float | None = None,
    figure: bool = False,
    config: Pathlike | None = None,
    **parameters: Numbers,
) -> Branches:
    """Continues a model's steady-state motions as a parameter varies, like `trilink branches`.

    campaign: name of a `[campaign.*]`.
    over: the parameter and its range, such as ("omega_rad_s", 0.5, 12) or ("skid1_kg_s", 20, 400).
    model: name of a model; by default skid-roll or, with `fitted`, the preferred model of the comparison.
    fitted: use the coefficients that were fitted to the campaign's trials.
    omega_rad_s: frequency, rad/s, if another parameter varies.
    figure: also draw the bifurcation diagram.
    config: as for `run`.
    parameters: values that replace parameters of the robot or the gait, as for `simulate`.

    >>> import trilink
    >>> found = trilink.branches("kinematic-skewed", over=("omega_rad_s", 1, 2), model="skid-roll", figure=True)
    >>> set(found.points["status"]), found.figure
    ({'stable'}, <trilink.Figure branches>)
    """
    key, low, high = over
    done, drawn = _draw(
        figure,
        lambda file: call(
            "branches",
            campaign,
            config=config,
            settings=parameters,
            over=f"{key}={interval((low, high))}",
            model=model,
            fitted=fitted,
            omega=omega_rad_s,
            figure=file,
        ),
        "branches",
    )
    return Branches(done.tables["rows"], drawn)


def design(
    campaign: str,
    *,
    model: str | None = None,
    add: int = 3,
    repeats: int = 1,
    omega_rad_s: Numbers | None = None,
    amplitude_deg: Numbers | None = None,
    candidates: Texts | None = None,
    optimality: Literal["d", "a"] | None = None,
    prediction: tuple[str, float] | None = None,
    tell: str | None = None,
    config: Pathlike | None = None,
) -> Design:
    """Recommends the next trials, like `trilink design`: to identify the coefficients, to improve a prediction, or to
    discriminate between two models.

    campaign: name of a `[campaign.*]` whose trials were fitted.
    model: name of a model; by default, the preferred model of the comparison.
    add: number of trials to add. repeats: maximum number of repeats of one trial.
    omega_rad_s, amplitude_deg: candidate frequencies, rad/s, and amplitudes of the commanded joints, degrees.
    candidates: campaigns of the same robot whose gaits are candidates.
    optimality: d for the volume of the confidence region (the default), a for the mean variance of the logarithms.
    prediction: minimise the uncertainty of a metric at a frequency in rad/s, such as ("d", 2.5).
    tell: choose the trials that best discriminate between the model and this one.
    config: as for `run`.

    >>> import trilink
    >>> advice = trilink.design("kinematic-skewed", add=2)
    >>> len(advice.trials), advice.expected["quantity"].tolist()
    (2, ['skid0_kg_s', 'skid1_kg_s', 'skid2_kg_s'])
    """
    aim = None if prediction is None else f"{prediction[0]} at {numbers(prediction[1])}"
    done = call(
        "design",
        campaign,
        config=config,
        model=model,
        add=add,
        repeats=repeats,
        omega=None if omega_rad_s is None else numbers(omega_rad_s),
        amplitude_deg=None if amplitude_deg is None else numbers(amplitude_deg),
        candidates=candidates,
        optimality=optimality,
        tell=tell,
        json=True,
        for_=aim,
    )
    return from_json(Design, done.json, **done.tables)


def sensitivities(
    campaign: str,
    *,
    omega_rad_s: Numbers,
    model: Texts | None = None,
    fitted: bool = False,
    from_rest: bool = False,
    monte_carlo: int | None = None,
    figure: bool = False,
    config: Pathlike | None = None,
    **parameters: Numbers,
) -> Sensitivities:
    """Computes the derivatives of a model's metrics and their uncertainty budgets, like `trilink simulate
    --sensitivities`.

    campaign, omega_rad_s, model, fitted, from_rest, config, parameters: as for `simulate`; several models may be named.
    monte_carlo: also propagate the uncertainties by this number of motions with inputs drawn at random.
    figure: also draw the elasticities; for a single motion.

    >>> import trilink
    >>> rows = trilink.sensitivities("kinematic-skewed", omega_rad_s=3, fitted=True).rows
    >>> rows["parameter"][0], rows["metric"][0]
    ('h_m', 'd_m')
    """
    done, drawn = _draw(
        figure,
        lambda file: call(
            "simulate",
            campaign,
            config=config,
            settings=parameters,
            omega=numbers(omega_rad_s),
            model=model,
            fitted=fitted,
            from_rest=from_rest,
            monte_carlo=monte_carlo,
            sensitivities=True,
            figure=file,
        ),
        "sensitivities",
    )
    return Sensitivities(done.tables["rows"], drawn)


def _draw(
    is_drawn: bool, command: Callable[[Path | None], Returned], name: str
) -> tuple[Returned, Figure | None]:
    """Calls a command with a file for its figure, if it is to be drawn, and returns the figure as well."""
    if not is_drawn:
        return command(None), None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.svg"
        done = command(file)
        return done, Figure(file) if file.exists() else None


@dataclass(frozen=True)
class _Drawn:
    """Page and names of the figures of a report."""

    page: Path
    figures: list[str]
    missing: list[str]


def path_text(path: Pathlike | None) -> str | None:
    """Returns a path as text."""
    return None if path is None else os.fspath(path)
