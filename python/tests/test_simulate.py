"""Tests that `trilink.simulate` agrees with `trilink simulate --json` and takes barely longer than the solver."""

import dataclasses
import json
import os
import re
import subprocess
import sys

import numpy
import polars
import polars.testing
import pytest
import trilink

SKID = (104.0, 34.0, 45.0)


def by_program(program, *arguments, folder):
    command = [program, "simulate", *arguments, "--json", "--quiet"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert said.stderr == ""
    return json.loads(said.stdout)


def check_same(motions, known):
    """Checks that motions agree with the objects that the program prints as JSON."""
    assert len(motions) == len(known)
    for motion, printed in zip(motions, known):
        fields = dataclasses.asdict(motion)
        assert set(printed) <= set(fields)
        for name, value in printed.items():
            found = fields[name]
            assert (list(found) if isinstance(found, tuple) else found) == value, name


def test_results_agree_with_the_program(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    known = by_program(
        program,
        "kinematic-symmetric",
        "--model=skid-roll",
        "--omega=2,3.9",
        "--set=skid_kg_s=104,34,45",
        folder=tmp_path,
    )
    found = trilink.simulate(
        "kinematic-symmetric", model="skid-roll", omega_rad_s=[2, 3.9], skid_kg_s=SKID
    )
    check_same(found, known)
    for frequency in (3.9, numpy.float64(3.9)):
        one = trilink.simulate(
            "kinematic-symmetric",
            model="skid-roll",
            omega_rad_s=frequency,
            skid_kg_s=numpy.array(SKID),
        )
        check_same([one], known[1:])
    assert abs(one.d_m - 0.478359748170948) < 1e-10


def test_a_robot_and_a_gait_can_replace_a_campaign(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    of_campaign = trilink.simulate("kinematic-symmetric", model="skid-roll", omega_rad_s=3.0)
    model = {"model": "skid-roll", "omega_rad_s": 3.0}
    assert trilink.simulate(robot="kinematic", gait="symmetric", **model) == of_campaign
    assert trilink.simulate("kinematic-skewed", gait="symmetric", **model) == of_campaign
    robot = {
        key: value
        for key, value in of_campaign.parameters.items()
        if key in ("h_m", "l_m", "b_m", "mass_kg", "inertia_kg_m2", "roll_kg_s", "skid_kg_s")
    }
    joint = {"amplitude_deg": 30, "offset_deg": 5}
    gait = {"joint1": joint, "joint2": {**joint, "phase_deg": 90}}
    given = trilink.simulate(robot=robot, gait=gait, skid1_kg_s=40, **model)
    assert given.status == "stable" and given.d_m != of_campaign.d_m
    assert given.parameters["skid_kg_s"][1] == 40


def test_a_chain_can_be_given_by_its_keys(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wheel = {"mass_kg": 0.3, "inertia_kg_m2": 5e-4, "wheel_m": 0, "skid_kg_s": 50, "roll_kg_s": 0.3}
    links = [{**wheel, "rear_joint_m": 0.05}, {**wheel, "front_joint_m": 0.2}]
    chain = {"links": links, "joints": [{"kind": "driven"}]}
    gait = {"joint1": {"amplitude_deg": 30}}
    of = {"gait": gait, "model": "skid-roll", "omega_rad_s": 3.0}
    motion = trilink.simulate(robot=chain, **of)
    assert motion.status == "stable" and motion.d_m > 0
    for wrong, message in [
        ({**chain, "links": links[:1]}, "links"),
        ({**chain, "joints": [{"kind": "elastic"}]}, "stiffness_nm_rad"),
        ({**chain, "h_m": 0.1}, "invalid key `h_m` beside `links`"),
    ]:
        with pytest.raises(trilink.ConfigError, match=message):
            trilink.simulate(robot=wrong, **of)


def test_trajectories_agree_with_the_table_of_the_program(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = [program, "simulate", "kinematic-symmetric", "--model=skid-roll", "--omega=3.9"]
    command += ["--trajectory=cycle.parquet", "--samples=120", "--quiet"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    known = polars.read_parquet("cycle.parquet")
    answer = trilink.simulate(
        "kinematic-symmetric", model="skid-roll", omega_rad_s=3.9, samples=120
    )
    found = answer.trajectory
    polars.testing.assert_frame_equal(found.to_polars(), known)
    assert found["x_m"].dtype == numpy.float64 and found["x_m"].shape == (121,)
    assert found["x_m"][-1] ** 2 + found["y_m"][-1] ** 2 == pytest.approx(answer.d_m**2)
    several = trilink.simulate(
        "kinematic-symmetric", model="skid-roll", omega_rad_s=(2.0, 3.0), samples=8, from_rest=True
    )
    assert all(len(of.trajectory) > 9 for of in several)


def test_the_result_says_why_a_motion_does_not_exist(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gait = {"joint1": {"amplitude_deg": 40}, "joint2": {"amplitude_deg": 40}}
    answer = trilink.simulate(
        robot="kinematic", gait=gait, model="no-skid", omega_rad_s=3.0, samples=8
    )
    assert numpy.isnan(answer.d_m) and answer.trajectory is None
    assert answer.status == "singular" and "det W_b = 0" in answer.reason


def test_error_messages_agree_with_the_program(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for campaign, model, settings in [
        ("kinematic", "skid", {}),
        ("kinematic-skewed", "skids", {}),
        ("kinematic-skewed", "no-skid-measured", {}),
        ("kinematic-skewed", "skid", {"skid_kgs": 3}),
        ("kinematic-skewed", "skid", {"h_m": -1}),
    ]:
        command = [program, "simulate", campaign, f"--model={model}", "--omega=3"]
        command += [f"--set={key}={float(value)}" for key, value in settings.items()]
        said = subprocess.run(command, capture_output=True, text=True)
        with pytest.raises(trilink.ConfigError) as caught:
            trilink.simulate(campaign, model=model, omega_rad_s=3.0, **settings)
        # The program first says that there is no pipeline.toml, and names options.
        named = re.sub("--set:? |--", "", said.stderr)
        assert said.returncode == 2 and named.endswith(f"\nerror: {caught.value}\n")
    model = {"model": "skid", "omega_rad_s": 3.0}
    for arguments, words in [
        ({}, "pass a campaign, or a robot and a gait"),
        ({"robot": "kinematic"}, "found a robot without a gait"),
        ({"gait": {"joint8": {}}, "robot": "kinematic"}, "unknown field `joint8`"),
        (
            {"gait": {"joint3": {"amplitude_deg": 9}}, "robot": "kinematic"},
            "gait.given.joint3`: found a command, needed no command, because robot `kinematic`",
        ),
        ({"gait": "symmetrical", "robot": "kinematic"}, "needed one of `"),
        ({"campaign": "kinematic-skewed", "samples": 3}, "samples: found 3"),
        (
            {"campaign": "kinematic-skewed", "omega_rad_s": -1},
            "omega_rad_s: found -1, needed a fre",
        ),
        ({"campaign": "kinematic-skewed", "omega_rad_s": [2, 0]}, "omega_rad_s: found 0, needed a"),
        ({"campaign": "kinematic-skewed", "model": None}, "model: found none, needed"),
        (
            {"campaign": "kinematic-skewed", "bands": True},
            "bands: found no fit, needed fitted=True",
        ),
        (
            {"campaign": "kinematic-skewed", "fitted": True, "gait": "skewed"},
            "fitted: found another",
        ),
        ({"campaign": "kinematic-skewed", "config": "none.toml"}, "none.toml: cannot be read"),
    ]:
        with pytest.raises(trilink.ConfigError, match=words.replace("(", "\\(")):
            trilink.simulate(**{**model, **arguments})
    with pytest.raises(trilink.TableError, match="fits.parquet: does not exist; `trilink run` or"):
        trilink.simulate("kinematic-skewed", fitted=True, omega_rad_s=2)
    assert issubclass(trilink.ConfigError, trilink.Error) and issubclass(
        trilink.ConfigError, ValueError
    )


def test_fitted_motions_agree_with_the_program(project, program, monkeypatch):
    folder = project[0]
    monkeypatch.chdir(folder)
    line = ("kinematic-skewed", "--fitted", "--bands", "--omega=2,3.9")
    command = [program, "simulate", *line, "--json", "--quiet"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    motions = trilink.simulate("kinematic-skewed", fitted=True, bands=True, omega_rad_s=[2, 3.9])
    known = json.loads(said.stdout)
    for motion in known:  # Confidence limits have lists in JSON and tuples in Python.
        for limit in ("lower", "upper"):
            motion[limit]["sigma"] = tuple(motion[limit]["sigma"])
    check_same(motions, known)
    assert motions[0].fit.adequate and motions[0].lower.d_m < motions[0].d_m < motions[0].upper.d_m
    with pytest.warns(trilink.Caution, match="the model does not fit"):
        trilink.simulate("kinematic-skewed", model="skid", fitted=True, omega_rad_s=2)


TIMES = """
import sys, time, trilink
case = dict(model="skid-roll", skid_kg_s=[104, 34, 45])
omegas = [2 + i / 100 for i in range(200)]
def best(work):
    times = []
    for _ in range(5):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)
def one_by_one():
    for omega_rad_s in omegas:
        trilink.simulate("kinematic-symmetric", omega_rad_s=omega_rad_s, **case)
together = best(lambda: trilink.simulate("kinematic-symmetric", omega_rad_s=omegas, **case))
alone = best(one_by_one)
print(1e3 * alone / len(omegas), 1e3 * together / len(omegas))
"""


def test_a_call_takes_barely_longer_than_the_solver(tmp_path):
    """Compares one call for many frequencies with one call per frequency, on a single thread."""
    command = [sys.executable, "-c", TIMES]
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    said = subprocess.run(
        command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
    )
    alone_ms, together_ms = map(float, said.stdout.split())
    print(f"{alone_ms:.3f} ms a call, {together_ms:.3f} ms of them the solver's")
    assert alone_ms - together_ms < 0.3
