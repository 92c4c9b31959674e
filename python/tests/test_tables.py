"""Tests that polars, pandas, DuckDB and pyarrow receive tables with the same values and without copying."""

import datetime
import gc
import re
import subprocess

import duckdb
import numpy
import pandas
import polars
import polars.testing
import pyarrow
import pytest
import trilink


def names(folder):
    tables = sorted(folder.rglob("*.parquet"))
    return [table.relative_to(folder).with_suffix("").as_posix() for table in tables]


def test_every_table_agrees_with_its_file_in_every_library(project):
    derived = project[0] / "derived"
    assert {"trials", "fits", "checks", "starts", "predictions"} <= set(names(derived))
    for name in names(derived):
        table = own = trilink.read(name, folder=derived)
        known = polars.read_parquet(derived / f"{name}.parquet")
        polars.testing.assert_frame_equal(polars.DataFrame(table), known)
        assert (len(table), table.columns) == known.shape[:1] + (known.columns,)
        arrow = pyarrow.table(table)
        polars.testing.assert_frame_equal(polars.DataFrame(arrow), known)
        frame = pandas.DataFrame.from_arrow(table)
        assert (frame.shape, list(frame.columns)) == (known.shape, known.columns), name
        assert len(frame.dropna()) == len(pandas.read_parquet(derived / f"{name}.parquet").dropna())
        relation = duckdb.sql("from own")
        assert relation.columns == known.columns
        assert relation.fetchall() == known.rows(), name


def test_columns_and_rows_of_a_table_can_be_selected(project):
    derived = project[0] / "derived"
    part = trilink.read(
        "trials", folder=derived, columns=["trial", "d_m"], where="omega_rad_s > 2.5"
    )
    assert part.columns == ["trial", "d_m"]
    assert len(part) == 3 == len(polars.DataFrame(part))
    assert part.units["d_m"] == "m"
    assert "per cycle" in part.meanings["d_m"]
    assert len(trilink.read("trials", config=project[0] / "pipeline.toml", where="d_m > 100")) == 0


def test_columns_are_numpy_arrays_of_their_types(project):
    derived = project[0] / "derived"
    trials = trilink.read("trials", folder=derived)
    known = polars.DataFrame(trials)
    for name in trials:
        values = trials[name]
        expected = known[name].to_list()
        if values.dtype == object:
            assert values.tolist() == expected, name
        else:
            same = [
                a == b or (b is None and a != a) or (a != a and b != b)
                for a, b in zip(values, expected)
            ]
            assert all(same), name
    kinds = {trials[name].dtype.kind for name in trials}
    assert {"f", "i", "O"} <= kinds
    assert numpy.nansum(trials["d_m"]) == pytest.approx(known["d_m"].sum())
    assert trilink.read("trials", folder=derived, where="d_m > 100")["d_m"].shape == (0,)
    column = trials["d_m"]
    column[:] = 0.0  # A column is a writable copy.
    assert numpy.nansum(trials["d_m"]) > 0


def test_columns_of_other_programs_have_their_types(tmp_path):
    times = [datetime.datetime(2026, 1, 2, 3, 4, 5, 678000), None]
    columns = {
        "lists": [[1.5, 2.5], [3.5, 4.5]],
        "times": times,
        "flags": [True, None],
        "counts": [1, None],
        "sure": [True, False],
        "whole": [1, 2],
    }
    polars.DataFrame(columns).write_parquet(tmp_path / "own.parquet")
    own = trilink.read(tmp_path / "own.parquet")
    assert own["lists"].tolist() == columns["lists"] and own["flags"].tolist() == [True, None]
    assert own["times"][0] == numpy.datetime64(times[0]) and numpy.isnat(own["times"][1])
    assert own["counts"][0] == 1.0 and numpy.isnan(own["counts"][1])
    assert own["sure"].dtype == bool and own["whole"].dtype == numpy.int64


def test_parts_of_a_table_are_tables(project):
    trials = trilink.read("trials", folder=project[0] / "derived")
    known = polars.DataFrame(trials)
    polars.testing.assert_frame_equal(trials[2:4].to_polars(), known[2:4])
    polars.testing.assert_frame_equal(trials[-2:].to_polars(), known[-2:])
    polars.testing.assert_frame_equal(trials[["d_m", "trial"]].to_polars(), known[["d_m", "trial"]])
    assert len(trials[4:2]) == 0 and len(trials.head(100)) == len(known)
    assert set(dict(trials)) == set(known.columns) and "d_m" in trials and "d_mm" not in trials
    for key in ("d_mm", ["d_m", "d_mm"]):
        with pytest.raises(KeyError, match="found column 'd_mm', needed one of "):
            trials[key]
    with pytest.raises(ValueError, match="step 2"):
        trials[::2]


def test_a_notebook_shows_the_first_rows_with_units_and_escapes_names(project):
    trials = trilink.read("trials", folder=project[0] / "derived", columns=["trial", "d_m"])
    html = trials._repr_html_()
    assert (
        html.count("<tr>") == 2 + len(trials)
        and "<th>m</th>" in html
        and "6 rows, 2 columns" in html
    )
    one = trilink.Table(trilink._trilink.table([("<b>", ["<script>"])]))
    assert "<script>" not in one._repr_html_() and "&lt;b&gt;" in one._repr_html_()


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """Returns a table of a million rows in a single row group, as trilink writes its tables."""
    path = tmp_path_factory.mktemp("large") / "large.parquet"
    index = polars.int_range(1_000_000, eager=True)
    columns = {"frame": index, "x_m": index / 7, "y_m": (index * 3).cast(polars.Float64).sqrt()}
    polars.DataFrame(columns).write_parquet(path, row_group_size=1_000_000)
    return trilink.read(path)


def addresses(table):
    """Returns the memory address of the values of each column."""
    return [column.chunk(0).buffers()[1].address for column in table.columns]


def test_a_million_rows_are_passed_on_without_copying(large):
    assert len(large) == 1_000_000
    taken = pyarrow.table(large)
    assert [column.num_chunks for column in taken.columns] == [1, 1, 1]
    own = addresses(taken)
    frame = polars.DataFrame(large)
    in_numpy = [column.to_numpy(allow_copy=False) for column in frame.get_columns()]
    assert [values.ctypes.data for values in in_numpy] == own
    in_pandas = pandas.DataFrame.from_arrow(large)
    allocated = pyarrow.total_allocated_bytes()
    again = pyarrow.table(large)
    assert pyarrow.total_allocated_bytes() == allocated and addresses(again) == own
    assert in_pandas["x_m"].sum() == pytest.approx(frame["x_m"].sum())
    streamed = duckdb.sql("select sum(x_m), count(*) from large").fetchall()
    assert streamed[0] == (pytest.approx(frame["x_m"].sum()), 1_000_000)


def test_memory_is_kept_while_the_table_is_in_use(project):
    table = trilink.read("trials", folder=project[0] / "derived")
    known = polars.DataFrame(table).to_dicts()
    frame, capsule = polars.DataFrame(table), table.__arrow_c_stream__()
    del table
    gc.collect()
    assert frame.to_dicts() == known
    # A capsule that was never consumed frees its stream.
    del capsule, frame
    gc.collect()


def test_error_messages_agree_with_the_program(project, program, tmp_path):
    derived = project[0] / "derived"
    damaged = tmp_path / "damaged.parquet"
    whole = (derived / "trials.parquet").read_bytes()
    damaged.write_bytes(whole[:500] + bytes(len(whole) - 1000) + whole[-500:])
    (tmp_path / "text.parquet").write_text("no table")
    for table, arguments, options in [
        ("trails", {}, []),
        ("trials", {"where": "d_mm > 3"}, ["--where", "d_mm > 3"]),
        ("trials", {"where": "d_m >"}, ["--where", "d_m >"]),
        ("trials", {"columns": ["d_mm"]}, ["--columns", "d_mm"]),
        (str(tmp_path / "text.parquet"), {}, []),
        (str(damaged), {}, []),
    ]:
        command = [program, "inspect", table, *options]
        said = subprocess.run(command, cwd=project[0], capture_output=True, text=True)
        with pytest.raises(trilink.TableError) as caught:
            trilink.read(table, config=project[0] / "pipeline.toml", **arguments)
        # Python runs in another folder, so its messages contain absolute paths.
        found = str(caught.value).replace(f"{project[0]}/", "")
        named = re.sub("--([a-z]+)", r"\1", said.stderr)
        assert said.returncode == 2 and named == f"error: {found}\n"
