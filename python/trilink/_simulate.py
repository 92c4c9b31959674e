"""Steady-state motions of a model."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, overload

from . import _trilink
from ._call import Numbers, Pathlike, caution, list_from_json, numbers, plain
from ._commands import path_text
from ._errors import ConfigError
from ._results import Motion
from ._table import Table

if TYPE_CHECKING:
    from ._table import Array

Keys = Mapping[str, object]


@overload
def simulate(
    campaign: str | None = ...,
    *,
    omega_rad_s: float,
    model: str | None = ...,
    fitted: bool = ...,
    bands: bool = ...,
    robot: str | Keys | None = ...,
    gait: str | Keys | None = ...,
    from_rest: bool = ...,
    samples: int | None = ...,
    config: Pathlike | None = ...,
    **parameters: Numbers,
) -> Motion: ...
@overload
def simulate(
    campaign: str | None = ...,
    *,
    omega_rad_s: Sequence[float] | Array,
    model: str | None = ...,
    fitted: bool = ...,
    bands: bool = ...,
    robot: str | Keys | None = ...,
    gait: str | Keys | None = ...,
    from_rest: bool = ...,
    samples: int | None = ...,
    config: Pathlike | None = ...,
    **parameters: Numbers,
) -> list[Motion]: ...
def simulate(
    campaign: str | None = None,
    *,
    omega_rad_s: float | Sequence[float] | Array,
    model: str | None = None,
    fitted: bool = False,
    bands: bool = False,
    robot: str | Keys | None = None,
    gait: str | Keys | None = None,
    from_rest: bool = False,
    samples: int | None = None,
    config: Pathlike | None = None,
    **parameters: Numbers,
) -> Motion | list[Motion]:
    """Solves for a model's steady-state motion, like `trilink simulate`; one motion for each frequency.

    campaign: name of a `[campaign.*]` in the configuration, which defines the robot and the gait.
    omega_rad_s: one or several frequencies, rad/s.
    model: name of a model: no-skid, skid, skid-roll, coulomb, ... or a `[model.*]` in the configuration; with
        `fitted`, by default the preferred model of the comparison.
    fitted: use the coefficients that were fitted to the campaign's trials.
    bands: with `fitted`, add 95 % confidence limits of the metrics.
    robot, gait: alternatives to `campaign`, or replacements for its robot or gait: names of a `[robot.*]` and a
        `[gait.*]` in the configuration, or the contents of such tables.
    from_rest: solve for the motion into which the robot settles from rest.
    samples: add the `trajectory` of one steady-state cycle, divided into this number of intervals, 8 to 100000; with
        `from_rest`, the trajectory covers all cycles from rest to the steady state and one more.
    config: path of a `pipeline.toml`; by default, the one in the current folder or, if there is none, the values of
        the paper.
    parameters: values that replace parameters of the robot, such as skid_kg_s=[104, 34, 45] or, for one wheel,
        skid1_kg_s=34, or of the commanded joints, such as amplitude1_deg=25.

    >>> import trilink
    >>> motion = trilink.simulate(
    ...     "kinematic-skewed", model="skid-roll", omega_rad_s=3.9, skid_kg_s=[73, 83, 97], samples=100
    ... )
    >>> round(motion.d_m, 4), motion.status, len(motion.trajectory["x_m"])
    (0.0956, 'stable', 101)
    >>> two = trilink.simulate("kinematic-skewed", omega_rad_s=[2, 3], fitted=True, bands=True)
    >>> all(motion.lower.d_m < motion.d_m < motion.upper.d_m for motion in two)
    True
    >>> trilink.simulate("kinematic-skewed", model="skid-roll", omega_rad_s=-1)
    Traceback (most recent call last):
    trilink.ConfigError: omega_rad_s: found -1, needed a frequency above 0
    """
    if samples is not None and not 8 <= samples <= 100_000:
        raise ConfigError(f"samples: found {samples}, needed 8 to 100000")
    omegas = plain(omega_rad_s)
    is_one = isinstance(omegas, (int, float))
    request = {
        "config": path_text(config),
        "campaign": campaign,
        "robot": robot if robot is None or isinstance(robot, str) else dict(robot),
        "gait": gait if gait is None or isinstance(gait, str) else dict(gait),
        "model": model,
        "fitted": fitted,
        "bands": bands,
        "omegas_rad_s": [omegas] if isinstance(omegas, (int, float)) else list(map(float, omegas)),
        "settings": [f"{key}={numbers(value)}" for key, value in parameters.items()],
        "from_rest": from_rest,
        "samples": samples,
    }
    text, trajectories, remark = _trilink.simulate(json.dumps(request, default=plain))
    if remark:
        caution(f"{campaign}: {remark}")
    motions = list_from_json(Motion, text)
    for number, access in enumerate(trajectories):
        if access is not None:
            motions[number] = dataclasses.replace(motions[number], trajectory=Table(access))
    return motions[0] if is_one else motions
