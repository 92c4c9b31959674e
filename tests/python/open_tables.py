"""Opens the tables of a folder with polars, pandas and DuckDB, as far as they are installed.

    python open_tables.py DERIVED VALUES

Names and types must be those that trilink promises, and values those of VALUES, a folder with
what `trilink inspect TABLE --json` prints of every table. Ends with status 77 if there is
nothing to open tables with.
"""

import importlib
import json
import math
import sys
from pathlib import Path

POSES = (
    "trial:text frame:whole time_s x_m y_m theta_rad phi1_rad phi2_rad residual0_mm residual1_mm"
    " residual2_mm fill0:text fill1:text fill2:text"
)
WHEELS = (
    "trial:text frame:whole time_s roll0_m_s roll1_m_s roll2_m_s skid0_m_s skid1_m_s skid2_m_s"
)
CYCLES = (
    "trial:text cycle:whole start_s d_m v_m_s sigma0 sigma1 sigma2 alpha1_rad dtheta_rad"
    " used:boolean"
)
TRIALS = (
    "trial:text campaign:text kind:text omega_commanded_rad_s omega_rad_s omega_rad_s_se"
    " cycles:whole d_m d_m_se v_m_s v_m_s_se sigma0 sigma0_se sigma1 sigma1_se sigma2 sigma2_se"
    " sigma0_debiased sigma0_debiased_se sigma1_debiased sigma1_debiased_se sigma2_debiased"
    " sigma2_debiased_se alpha1_rad alpha1_rad_se dtheta_rad dtheta_rad_se phi1_offset_rad"
    " phi1_amplitude_rad phi1_phase_rad phi2_offset_rad phi2_amplitude_rad phi2_phase_rad"
    " coverage residual_mm status:text message:text"
)
CHECKS = "trial:text check:text severity:text value limit message:text"
FITS = (
    "campaign:text model:text skid0_kg_s skid1_kg_s skid2_kg_s roll0_kg_s roll1_kg_s roll2_kg_s"
    " stiffness_nm_rad damping_nm_s_rad skid0_kg_s_lo skid0_kg_s_hi free:text at_bound:text j"
    " starts:whole solves:whole status:text"
)
STARTS = "campaign:text model:text start:whole j solves:whole stopped:text"
PROFILES = "campaign:text model:text parameter:text value j"
BOOTSTRAP = "campaign:text model:text replicate:whole j solves:whole stopped:text"
PREDICTIONS = (
    "campaign:text model:text trial:text omega_rad_s source:text d_m v_m_s sigma0 sigma1 sigma2 alpha1_rad"
    " dtheta_rad j status:text"
)
RESIDUALS = (
    "campaign:text model:text trial:text omega_rad_s metric:text measured predicted residual"
    " standard_error residual_standard_errors"
)

PROMISED = {
    "poses/*": POSES,
    "wheels/*": WHEELS,
    "cycles/*": CYCLES,
    "trials": TRIALS,
    "checks": CHECKS,
    "fits": FITS,
    "starts": STARTS,
    "profiles": PROFILES,
    "bootstrap": BOOTSTRAP,
    "predictions": PREDICTIONS,
    "residuals": RESIDUALS,
}


def with_polars(polars, path):
    """Names with kinds, and rows as dictionaries."""
    table = polars.read_parquet(path)
    kinds = {
        polars.String: "text",
        polars.Float64: "number",
        polars.Int64: "whole",
        polars.Boolean: "boolean",
    }
    return {name: kinds[dtype] for name, dtype in table.schema.items()}, table.to_dicts()


def with_pandas(pandas, path):
    table = pandas.read_parquet(path)

    def kind(column):
        name = str(column.dtype)
        if name.startswith(("int", "float", "bool")):
            return {"int64": "whole", "float64": "number", "bool": "boolean"}[name]
        return "text"

    return {name: kind(table[name]) for name in table.columns}, table.to_dict("records")


def with_duckdb(duckdb, path):
    relation = duckdb.sql(f"select * from '{path}'")
    kinds = {
        "VARCHAR": "text",
        "DOUBLE": "number",
        "BIGINT": "whole",
        "BOOLEAN": "boolean",
    }
    names = relation.columns
    rows = [dict(zip(names, row)) for row in relation.fetchall()]
    return {name: kinds[str(kind)] for name, kind in zip(names, relation.types)}, rows


def is_missing(value):
    return value is None or isinstance(value, float) and math.isnan(value)


def is_same(found, known):
    return is_missing(found) and is_missing(known) or found == known


def check(where, found, rows, promised, known):
    """Says what is not as promised."""
    problems = []
    for column in promised.split():
        name, _, kind = column.partition(":")
        kind = kind or "number"
        if found.get(name) != kind:
            problems.append(f"{where}: {name}: found {found.get(name)}, needed {kind}")
    places = [list(found).index(c.partition(":")[0]) for c in promised.split() if not problems]
    if places != sorted(places):
        problems.append(f"{where}: the columns stand in another order")
    if len(rows) != len(known):
        problems.append(f"{where}: found {len(rows)} rows, needed {len(known)}")
    for number, (row, expected) in enumerate(zip(rows, known)):
        if list(row) != list(expected):
            problems.append(f"{where}: columns are not those that inspect shows")
            break
        for name in row:
            if not is_same(row[name], expected[name]):
                problems.append(
                    f"{where}, row {number}, {name}: found {row[name]!r}, needed {expected[name]!r}"
                )
    return problems


def main():
    derived, values = map(Path, sys.argv[1:3])
    readers = {"polars": with_polars, "pandas": with_pandas, "duckdb": with_duckdb}
    problems, used = [], []
    for library, read in readers.items():
        try:
            module = importlib.import_module(library)
            if library == "pandas":
                importlib.import_module("pyarrow")
        except ImportError as missing:
            print(f"left out: {library}: {missing}")
            continue
        used.append(library)
        for pattern, promised in PROMISED.items():
            paths = sorted(derived.glob(pattern + ".parquet"))
            if not paths:
                problems.append(f"no table {pattern} in {derived}")
            for path in paths:
                name = path.relative_to(derived).with_suffix(".json")
                known = json.loads((values / name).read_text())
                found, rows = read(module, path)
                problems += check(f"{library}: {name.with_suffix('')}", found, rows, promised, known)
    print("\n".join(problems[:20]))
    print(f"opened with {', '.join(used) or 'nothing'}: {len(problems)} problems")
    sys.exit(1 if problems else 0 if used else 77)


main()
