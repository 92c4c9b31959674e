"""Tests that `trilink.run` works like the program, can be interrupted, and does not block other threads."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import pytest
import trilink


def test_run_returns_a_summary_of_the_results(project):
    folder, done = project
    assert not done.was_up_to_date and not done.needs_attention
    results = done.results
    assert (results.trials.total, results.trials.ok, results.trials.failed) == (6, 6, 0)
    assert [fit.model for fit in results.fits] == ["skid", "skid-roll"]
    assert results.page.is_file() and done.derived == folder / "derived"
    assert {stage.stage for stage in done.stages} == {"ingest", "fit", "report"}
    again = trilink.run(folder / "pipeline.toml")
    assert again.was_up_to_date and again.results.fits == results.fits


def test_progress_is_shown_only_if_requested(project, capsys, monkeypatch):
    config = project[0] / "pipeline.toml"
    trilink.run(config, force=True)
    trilink.run(config, force=True, progress=False)
    assert capsys.readouterr().err == ""
    trilink.run(config, force=True, progress=True)
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith("ingest ") for line in lines) == 6
    assert sum(line.startswith("fit ") for line in lines) == 2
    assert any(line.startswith("report ") for line in lines)
    monkeypatch.setattr(sys, "stderr", None)  # As in a program without a console.
    assert trilink.run(config, progress=True).was_up_to_date


def test_the_installed_command_is_the_program(project, program):
    def run(*arguments):
        return subprocess.run([program, *arguments], cwd=project[0], capture_output=True, text=True)

    assert run("--version").stdout == f"trilink {trilink.__version__}\n"
    assert run("run", "--quiet").returncode == 0
    assert run("frobnicate").returncode == 2
    failed = run("inspect", "none")
    assert failed.returncode == 2
    assert failed.stderr.startswith("error: `none` is neither a table nor a file")
    missing = run("simulate", "kinematic-symmetric", "--model=skid", "--omega=3")
    assert missing.returncode == 2 and "needed one of `kinematic-skewed`" in missing.stderr
    as_module = subprocess.run([sys.executable, "-m", "trilink", "--version"], capture_output=True)
    assert as_module.stdout.decode() == run("--version").stdout


def test_configuration_errors_name_the_key_and_the_problem(project, tmp_path):
    config = tmp_path / "pipeline.toml"
    config.write_text("[fit]\nstarts = 0\n")
    with pytest.raises(trilink.ConfigError, match="key `fit.starts`: found 0, needed"):
        trilink.run(config)
    with pytest.raises(trilink.ConfigError, match="did you mean"):
        config.write_text("[fit]\nstart = 3\n")
        trilink.run(config)
    with pytest.raises(trilink.Error, match="trials.toml"):
        config.write_text("")
        trilink.run(config)


@pytest.fixture
def long(empty, tmp_path):
    """Creates a project whose fits take minutes."""
    folder = tmp_path / "long"
    shutil.copytree(empty, folder)
    config = folder / "pipeline.toml"
    config.write_text(config.read_text().replace("bootstrap = 40", "bootstrap = 20000"))
    return config


STOPPED = """
import sys, trilink
try:
    trilink.run(sys.argv[1])
except KeyboardInterrupt as stopped:
    print(stopped)
    # Later calls in the same process still work.
    print(trilink.simulate("kinematic-skewed", model="skid-roll", omega_rad_s=[2, 3], config=sys.argv[1])[1].status)
"""


@pytest.mark.skipif(os.name == "nt", reason="processes are sent no Ctrl-C")
def test_ctrl_c_stops_a_run_and_reports_the_progress(long):
    started = subprocess.Popen(
        [sys.executable, "-c", STOPPED, long], stdout=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while not (long.parent / "derived" / "trials.parquet").exists():
        assert time.monotonic() < deadline and started.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    started.send_signal(signal.SIGINT)
    stopped_at = time.monotonic()
    said, _ = started.communicate(timeout=60)
    assert time.monotonic() - stopped_at < 10
    assert said.startswith("interrupted during fit") and said.endswith("\nstable\n"), said
    assert started.returncode == 0


@pytest.mark.skipif(os.name == "nt", reason="processes are sent no Ctrl-C")
def test_ctrl_c_stops_the_command_with_exit_status_130(long, program):
    started = subprocess.Popen(
        [program, "run"], cwd=long.parent, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while not (long.parent / "derived" / "trials.parquet").exists():
        assert time.monotonic() < deadline and started.poll() is None
        time.sleep(0.05)
    started.send_signal(signal.SIGINT)
    _, said = started.communicate(timeout=60)
    assert started.returncode == 130 and b"Traceback" not in said, said


def test_other_threads_keep_working_during_a_run(empty, tmp_path):
    folder = tmp_path / "other"
    shutil.copytree(empty, folder)
    counted, done = 0, threading.Event()

    def count():
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    start = time.monotonic()
    trilink.run(folder / "pipeline.toml")
    took_s = time.monotonic() - start
    done.set()
    counter.join()
    assert counted > 50 * took_s, f"{counted} in {took_s} s"


@pytest.mark.skipif(os.name == "nt", reason="processes are sent no Ctrl-C")
def test_a_run_that_is_already_active_raises_busy_error(long):
    started = subprocess.Popen([sys.executable, "-c", STOPPED, long], stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (long.parent / "derived" / "trials.parquet").exists():
        assert time.monotonic() < deadline and started.poll() is None
        time.sleep(0.05)
    try:
        message = "with `wait`, the command waits until the lock is released"
        with pytest.raises(trilink.BusyError, match=message):
            trilink.run(long, force=True)
    finally:
        started.send_signal(signal.SIGINT)
        started.wait(60)
