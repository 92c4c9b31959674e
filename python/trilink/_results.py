"""Results of the program's commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ._figure import Figure
from ._table import Table


@dataclass(frozen=True)
class TrialCounts:
    """Numbers of trials by status."""

    total: int
    ok: int
    flagged: int
    failed: int
    ignored: int


@dataclass(frozen=True)
class Attention:
    """Trial that needs attention: its status, `flagged` or `failed`, and the reason."""

    trial: str
    status: str
    message: str


@dataclass(frozen=True)
class FitStatus:
    """Outcome of the fit of a model to a campaign."""

    campaign: str
    model: str
    status: str
    failure: str
    """Reason why the fit failed; empty if it did not."""
    j: float | None
    """Objective J (eq. 22 of the paper); None if the fit failed."""


@dataclass(frozen=True)
class Stage:
    """Stage of a run, with the names of the trials, fits or figures that were recomputed or removed."""

    stage: str
    seconds: float
    redone: list[str]
    up_to_date: int
    removed: list[str]


@dataclass(frozen=True)
class RunResults:
    """Trials, fits and files of a run."""

    trials: TrialCounts
    attention: list[Attention]
    fits: list[FitStatus]
    figures: list[str]
    """Names of the figures that were drawn; `report` returns the figures themselves."""
    missing: list[str]
    """Sentences about figures that could not be drawn."""
    page: Path
    scorecard: Path | None


@dataclass(frozen=True)
class Run:
    """Result of `run`."""

    was_up_to_date: bool
    """Whether nothing had to be recomputed."""
    results: RunResults
    stages: list[Stage]
    history_problem: str | None
    """Problem with the history of runs; None if there is none."""
    damaged: list[str]
    """Sentences about damaged tables."""
    derived: Path
    """Folder of the tables."""
    needs_attention: bool
    """Whether a person should look at the results: the exit status of the program would be 1."""


@dataclass(frozen=True)
class Fits:
    """Result of `fit`."""

    fits: Table
    """Table `fits`: a row for each model of each campaign."""
    comparison: Table
    """Table `comparison` of the models of each campaign."""
    needs_attention: bool


@dataclass(frozen=True)
class Report:
    """Result of `report`."""

    page: Path
    figures: Mapping[str, Figure]
    """Figures by name, such as `fig13` or `work`."""
    missing: list[str]
    """Sentences about figures that could not be drawn."""


@dataclass(frozen=True)
class Finding:
    """Finding of a check on a trial, as in the table `checks`."""

    check: str
    severity: str
    """`ok`, `info`, `warning` or `error`."""
    value: float
    limit: float
    message: str


@dataclass(frozen=True)
class CheckedTrial:
    """Result that the ingest would give for a trial."""

    trial: str
    status: str
    message: str
    cycles: int
    checks: list[Finding]


@dataclass(frozen=True)
class Section:
    """Table in a marker file."""

    name: str
    line: int
    rate_hz: float | None
    rows: int


@dataclass(frozen=True)
class MarkerCoverage:
    """Coverage of a marker: the fraction of frames in which it was visible, and the number of gaps."""

    label: str
    link: int | None
    ignored: bool
    coverage: float
    gaps: int


@dataclass(frozen=True)
class Gaps:
    """Gaps of all markers of a file."""

    count: int
    median_frames: int | None
    longest_frames: int | None
    median_s: float | None
    longest_s: float | None


@dataclass(frozen=True)
class Recording:
    """Markers of a file."""

    rate_hz: float | None
    first_frame: int
    last_frame: int
    rows: int
    frames_left_out: int
    rows_without_frame: int
    coverage: float
    markers: list[MarkerCoverage]
    gaps: Gaps


@dataclass(frozen=True)
class CheckedFile:
    """Contents and problems of a marker file."""

    file: Path
    readable: bool
    sections: list[Section]
    recording: Recording | None
    stops: list[str]
    """Problems that would prevent the ingest of the file."""
    warnings: list[str]


@dataclass(frozen=True)
class Check:
    """Result of `check`: trials if folders were checked, files if marker files were checked."""

    trials: list[CheckedTrial]
    files: list[CheckedFile]
    needs_attention: bool


@dataclass(frozen=True)
class JointSwing:
    """Motion of a joint in a gait, degrees; the phase is relative to joint 1."""

    offset_deg: float
    amplitude_deg: float
    phase_deg: float


@dataclass(frozen=True)
class FoundFile:
    """Marker file that `init` found."""

    folder: Path
    file: str
    subjects: list[str]
    labels: int
    rate_hz: float | None
    frames: int
    kind: str | None
    omega_rad_s: float | None
    joints: list[JointSwing] | None
    campaign: str | None
    problem: str | None
    """Reason why the file is not used; None if it is used."""


@dataclass(frozen=True)
class FoundCampaign:
    """Gait that several files have in common."""

    name: str
    files: int
    joints: list[JointSwing]
    passive_joint: int | None


@dataclass(frozen=True)
class Mark:
    """Line of a written file that a person has to review."""

    file: Path
    line: int
    of: str
    text: str


@dataclass(frozen=True)
class Init:
    """Result of `init`: what the marker files show, and the files that were written."""

    files: list[FoundFile]
    empty: list[Path]
    robot: str
    links: list[list[str]]
    """Names of the markers on the middle, front and rear links."""
    elsewhere: list[str]
    """Labels of markers that are on none of the links."""
    campaigns: list[FoundCampaign]
    written: list[Path]
    kept: list[Path]
    """Existing lists of trials, which were not changed."""
    marks: list[Mark]
    needs_attention: bool


@dataclass(frozen=True)
class RowId:
    """Row of a table: the trial, or the campaign and the model."""

    table: str
    row: str = field(metadata={"json": "of"})


@dataclass(frozen=True)
class Difference:
    """Value that differs from the baseline."""

    table: str
    row: str = field(metadata={"json": "of"})
    column: str
    baseline: float | str | bool | None
    now: float | str | bool | None = field(metadata={"json": "tonight"})
    verdict: str
    """`within` tolerance, `out` of tolerance, or `not-judged`."""
    limit: float | None
    """Largest difference within tolerance."""
    standard_errors: float | None
    """Difference in combined standard errors of both runs."""


@dataclass(frozen=True)
class Cause:
    """Likely cause of differences, which are given by their indices."""

    kind: str
    sentence: str
    differences: list[int]


@dataclass(frozen=True)
class RunTime:
    """Run times of a stage, s; `longer` if it exceeds the tolerance."""

    stage: str
    baseline_s: float
    now_s: float = field(metadata={"json": "tonight_s"})
    longer: bool


@dataclass(frozen=True)
class Comparison:
    """Result of `compare`."""

    within_tolerance: bool
    cells: int
    """Number of values compared."""
    causes: list[Cause]
    differences: list[Difference]
    appeared: list[RowId]
    vanished: list[RowId]
    run_times: list[RunTime]


@dataclass(frozen=True)
class Optima:
    """Result of `optimise`."""

    optima: Table
    """The optima, best first, or the Pareto front; columns as in the table `optima`."""
    is_usable: bool
    """Whether an optimum is stable and reached from rest."""
    figure: Figure | None
    """Objective around the optimum, or the Pareto front; None unless requested."""


@dataclass(frozen=True)
class Branches:
    """Result of `branches`."""

    points: Table
    """Points of the branches: parameter value, metrics, stability and bifurcations."""
    figure: Figure | None
    """Bifurcation diagram; None unless requested."""


@dataclass(frozen=True)
class Sensitivities:
    """Result of `sensitivities`."""

    rows: Table
    """Derivative, elasticity and contribution to the uncertainty of each metric with respect to each parameter."""
    figure: Figure | None
    """Elasticities; None unless requested."""


@dataclass(frozen=True)
class Undetermined:
    """Parameter that the trials hardly identify."""

    parameter: str
    deviation: float
    """Standard deviation of the logarithm of the parameter."""
    deviation_with: float
    """The same with the trial that helps most."""
    exchanged: dict[str, float]
    """Changes of other parameters, %, that compensate a change of this one by 1 %."""
    omega_rad_s: float | None
    campaign: str | None


@dataclass(frozen=True)
class Design:
    """Result of `design`."""

    campaign: str
    model: str
    is_best_of_all: bool
    """Whether every combination of candidates was compared."""
    without_motion: int
    """Number of candidates without a stable periodic motion."""
    tell: str | None
    standard_errors: float | None
    """Difference between the predictions of the two models, in standard errors; None without `tell`."""
    undetermined: list[Undetermined] = field(metadata={"json": "untold"})
    trials: Table = field(metadata={"json": ""})
    """Recommended trials."""
    expected: Table = field(metadata={"json": ""})
    """Present and expected half widths of the 95 % confidence intervals."""


ParameterValue = float | list[float] | dict[str, float]


@dataclass(frozen=True)
class Metrics:
    """Metrics of a cycle; NaN if unknown."""

    d_m: float
    """Displacement per cycle, m."""
    v_m_s: float
    """Mean speed, m/s."""
    sigma: tuple[float, ...]
    """Skid ratios of the wheels of the middle, front and rear links."""
    alpha1_rad: float
    """Amplitude of joint 1, or of the passive joint, rad."""
    dtheta_rad: float
    """Rotation per cycle, rad."""


@dataclass(frozen=True)
class SharpLimit:
    """Metrics extrapolated to zero transition speed of dry friction, with the error of the extrapolation."""

    metrics: Metrics
    uncertainty: Metrics


@dataclass(frozen=True)
class FitSummary:
    """Fit that provides the coefficients of a motion."""

    free: list[str]
    fitted_gait: str
    adequate: bool | None
    misfit: str | None
    at_bound: list[str]
    practically_not: list[str]
    structurally_not: list[str]


@dataclass(frozen=True)
class Motion(Metrics):
    """Result of `simulate`: the steady-state motion of a model at a frequency; NaN and a `reason` if there is none."""

    model: str
    omega_rad_s: float
    work_j: float
    """Work of the actuators per cycle, J."""
    work_j_m: float
    """Work of the actuators per metre of displacement, J/m."""
    cost_of_transport: float
    """Work of the actuators over weight and displacement."""
    status: str
    """Kind of motion, such as `stable` or `unstable`."""
    parameters: dict[str, ParameterValue]
    """Parameters of the robot, with the keys of `pipeline.toml`."""
    gait: dict[str, dict[str, float]]
    """Commands of the joints, with the keys of `pipeline.toml`."""
    reason: str | None = None
    """Reason why the motion does not exist."""
    floquet: float | None = None
    """Modulus of the largest Floquet multiplier."""
    from_rest: str | None = None
    """`reached` if the robot settles into the motion when it starts from rest."""
    cycles_to_settle: int | None = None
    sharp_limit: SharpLimit | None = None
    """For dry friction, the limit of zero transition speed."""
    lower: Metrics | None = None
    """Lower 95 % confidence limits, with `bands`."""
    upper: Metrics | None = None
    """Upper 95 % confidence limits, with `bands`."""
    no_interval: str | None = None
    """Reason why there are no confidence limits."""
    fit: FitSummary | None = None
    """Fit that provides the coefficients, with `fitted`."""
    extrapolated: bool | None = None
    """Whether the motion is beyond the trials of the fit."""
    beyond_trials: str | None = None
    trajectory: Table | None = None
    """Samples of the motion, with `samples`."""
