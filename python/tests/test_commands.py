"""Tests that the functions give what the commands of the program print."""

import inspect
import json
import re
import shutil
import signal
import subprocess
import sys
import time

import matplotlib
import numpy
import polars
import pytest
import trilink

CAMPAIGN = "kinematic-skewed"


@pytest.fixture
def here(project, monkeypatch):
    monkeypatch.chdir(project[0])
    return project[0]


@pytest.fixture
def printed(here, program):
    def run(*line):
        said = subprocess.run([program, *line, "--quiet"], capture_output=True, text=True, cwd=here)
        assert said.returncode < 2, said.stderr
        return json.loads(said.stdout)

    return run


def records(table):
    """Returns the rows of a table as the program prints them."""
    plain = lambda value: None if isinstance(value, float) and numpy.isnan(value) else value
    return [
        {name: plain(value) for name, value in row.items()}
        for row in polars.DataFrame(table).to_dicts()
    ]


# Options that only concern the command line, or that belong to another function.
OTHER = {
    "help",
    "version",
    "config",
    "quiet",
    "threads",
    "color",
    "log",
    "verbose",
    "json",
    "csv",
    "table",
    "set",
    "dry_run",
    "explain",
    "gait_toml",
    "shard",
    "trajectory",
    "page",
    "sensitivities",
    "bands",
    "samples",
    "figure",
}
RENAMED = {"omega": "omega_rad_s", "for": "prediction"}


@pytest.mark.parametrize(
    "name",
    [
        "init",
        "check",
        "run",
        "fit",
        "report",
        "compare",
        "optimise",
        "branches",
        "design",
        "sensitivities",
    ],
)
def test_every_option_has_an_argument(name, program):
    command = "simulate" if name == "sensitivities" else name
    text = subprocess.run([program, command, "--help"], capture_output=True, text=True).stdout
    options = {
        option.replace("-", "_") for option in re.findall(r"^ +(?:-\w, )?--([a-z-]+)", text, re.M)
    }
    arguments = set(inspect.signature(getattr(trilink, name)).parameters)
    lacking = {RENAMED.get(option, option) for option in options - OTHER} - arguments
    # Shards of a fit are for clusters.
    assert lacking <= ({"replicates"} if name == "fit" else set())


def test_check_agrees_with_the_program(here, printed):
    known = printed("check", "--json")
    checked = trilink.check()
    assert [trial.trial for trial in checked.trials] == [trial["trial"] for trial in known]
    assert [len(trial.checks) for trial in checked.trials] == [
        len(trial["checks"]) for trial in known
    ]
    assert checked.files == [] and not checked.needs_attention
    [known] = printed("check", "--json", "raw/demo/kinematic-skewed-2.00-r1.csv")
    [file] = trilink.check("raw/demo/kinematic-skewed-2.00-r1.csv").files
    assert file.recording.markers[3].label == known["recording"]["markers"][3]["label"]
    assert file.recording.gaps.count == known["recording"]["gaps"]["count"]
    with pytest.raises(trilink.Error, match="found both folders and files"):
        trilink.check("raw/demo", "raw/demo/kinematic-skewed-2.00-r1.csv")


def test_optimise_and_branches_agree_with_the_program(here, printed):
    known = printed(
        "optimise",
        CAMPAIGN,
        "--fitted",
        "--maximise=v",
        "--replicates=3",
        "--free=phase2",
        "--omega=3",
        "--json",
    )
    best = trilink.optimise(
        CAMPAIGN,
        maximise="v",
        fitted=True,
        replicates=3,
        free=["phase2"],
        omega_rad_s=3,
        figure=True,
    )
    assert records(best.optima) == known and best.is_usable
    assert best.figure.svg.startswith("<svg") and best.figure._repr_svg_() == best.figure.svg
    known = printed(
        "branches",
        CAMPAIGN,
        "--over=skid1_kg_s=50..60",
        "--omega=2",
        "--json",
        "--set=mass0_kg=1.1",
    )
    found = trilink.branches(CAMPAIGN, over=("skid1_kg_s", 50, 60), omega_rad_s=2.0, mass0_kg=1.1)
    assert records(found.points) == known and found.figure is None


def test_design_and_sensitivities_agree_with_the_program(here, printed):
    known = printed("design", CAMPAIGN, "--add=1", "--omega=1,2.5", "--for=d at 2.5", "--json")
    advice = trilink.design(CAMPAIGN, add=1, omega_rad_s=[1, 2.5], prediction=("d", 2.5))
    assert (
        records(advice.trials) == known["trials"] and records(advice.expected) == known["expected"]
    )
    assert advice.is_best_of_all == known["is_best_of_all"] and advice.model == "skid-roll"
    known = printed("simulate", CAMPAIGN, "--fitted", "--omega=2", "--sensitivities", "--json")
    assert records(trilink.sensitivities(CAMPAIGN, fitted=True, omega_rad_s=2).rows) == known


def test_compare_tells_what_has_changed(here, tmp_path):
    earlier = tmp_path / "earlier.json"
    assert trilink.compare(save=earlier) is None
    same = trilink.compare(earlier)
    assert same.within_tolerance and same.cells > 100 and same.run_times[0].baseline_s > 0
    text = json.loads(earlier.read_text())
    changed = re.sub(r'("d_m": ?)0\.0', r"\g<1>0.5", json.dumps(text))
    assert changed != json.dumps(text)
    earlier.write_text(changed)
    other = trilink.compare(earlier)
    assert not other.within_tolerance and other.causes[0].differences
    worst = other.differences[0]
    assert worst.verdict == "out" and worst.baseline > 0.5 > worst.now


def test_init_drafts_a_configuration(empty, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(empty / "raw" / "demo", "demo")
    (tmp_path / "demo" / "trials.toml").unlink()
    found = trilink.init("demo")
    assert [campaign.files for campaign in found.campaigns] == [5] and len(found.files) == 6
    assert (tmp_path / "pipeline.toml").is_file() and found.marks[0].line > 0
    with pytest.raises(
        trilink.Error, match="file already exists; `add` adds the robot of these folders"
    ):
        trilink.init("demo")
    with pytest.raises(ValueError, match="unit: found `ell`, needed mm, cm, m or in"):
        trilink.init("demo", unit="ell")


def test_figures_of_the_report_are_drawn_as_svg_and_by_matplotlib(here):
    matplotlib.use("Agg")
    figures = trilink.report().figures
    assert {"fig10", "work"} <= set(figures)
    for name, figure in figures.items():
        assert (
            figure.svg.startswith("<svg")
            and figure.png[1:4] == b"PNG"
            and figure.pdf[:4] == b"%PDF"
        )
        drawn = figure.plot()
        assert len(drawn.axes) == len(set(figure.data["panel"])), name
        assert all(axes.lines or axes.containers for axes in drawn.axes), name
        drawn.canvas.draw()


def test_markers_of_a_file_are_a_table(here):
    path = here / "raw" / "demo" / "kinematic-skewed-5.00-r1.csv"
    markers = trilink.mocap.read(path)
    checked = trilink.check(path).files[0].recording
    assert len(markers) == checked.rows * len(checked.markers)
    seen = numpy.isfinite(markers["x_mm"]).mean()
    assert seen == pytest.approx(checked.coverage)
    assert markers["time_s"][-1] == pytest.approx((checked.last_frame - checked.first_frame) / 120)
    assert markers["marker"][:2].tolist() == [marker.label for marker in checked.markers[:2]]
    with pytest.raises(trilink.Error, match="none.csv"):
        trilink.mocap.read("none.csv")
    with pytest.raises(ValueError, match="unit: found `ell`"):
        trilink.mocap.read(path, unit="ell")


def test_messages_name_arguments(here):
    cases = [
        (
            lambda: trilink.branches(CAMPAIGN, over=("omega_rad_s", 1, 2), omega_rad_s=2),
            "omega_rad_s: the frequency cannot be fixed, because `over omega_rad_s` varies it",
        ),
        (
            lambda: trilink.branches(CAMPAIGN, over=("omega_rad_s", 2, 1)),
            "over: found 2..1, needed the lower number first",
        ),
        (
            lambda: trilink.optimise(CAMPAIGN, maximise="w", model="skid"),
            "maximise: found `w`, needed `d`",
        ),
        (
            lambda: trilink.optimise(CAMPAIGN, maximise="v"),
            "required arguments were not provided: `model`",
        ),
        (
            lambda: trilink.optimise(CAMPAIGN, maximise="v", model="skid", replicates=3),
            "not provided: `fitted`",
        ),
        (
            lambda: trilink.optimise(CAMPAIGN, maximise="v", model="skid", skid_kgs=3),
            "skid_kgs=3.0: unknown",
        ),
        (
            lambda: trilink.design(CAMPAIGN, omega_rad_s=-1),
            "omega_rad_s: found -1, needed a frequency above 0",
        ),
        (lambda: trilink.design(CAMPAIGN, add=0), "add: 0 is not in 1..=50"),
        (lambda: trilink.compare(max_age="3"), "max_age: found `3`, needed a time such as 20h"),
    ]
    for wrong, words in cases:
        with pytest.raises(ValueError) as caught:
            wrong()
        assert words in str(caught.value) and "--" not in str(caught.value)


SEARCH = f"""
import sys, trilink
try:
    trilink.optimise("{CAMPAIGN}", maximise="v", model="skid-roll", starts=10000)
except KeyboardInterrupt:
    print("stopped", trilink.simulate("{CAMPAIGN}", model="skid-roll", omega_rad_s=2).status)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes are sent no Ctrl-C")
def test_ctrl_c_stops_a_search(here):
    started = subprocess.Popen(
        [sys.executable, "-c", SEARCH], cwd=here, stdout=subprocess.PIPE, text=True
    )
    time.sleep(3)
    assert started.poll() is None
    started.send_signal(signal.SIGINT)
    said, _ = started.communicate(timeout=60)
    assert said == "stopped stable\n" and started.returncode == 0
