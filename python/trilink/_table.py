"""Tables in memory."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from html import escape
from typing import TYPE_CHECKING, Any, overload

if TYPE_CHECKING:
    import numpy
    import pandas
    import polars

    Array = numpy.ndarray[Any, numpy.dtype[Any]]

_SHOWN_ROWS = 10


class Table:
    """Table in memory, which polars, pandas, DuckDB and pyarrow use without copying the data.

    A column is a NumPy array in which missing numbers are NaN and other missing values None; a list of names gives a
    table of these columns, and a slice a table of these rows.

    >>> import trilink
    >>> trials = trilink.read("trials", where="kind = 'gait'")
    >>> trials["omega_rad_s"].round(1)
    array([1. , 2. , 3. , 3.9, 5. ])
    >>> trials[["trial", "d_m"]].head(2)
    <trilink.Table: 2 rows, 2 columns>
    >>> trials.units["v_m_s"], trials.meanings["omega_rad_s"]
    ('m/s', 'frequency of the gait; of a trial the measured one')
    >>> trials.to_polars().height, trials.to_pandas().shape[0], len(trials)
    (5, 5, 5)
    """

    def __init__(self, access: Callable[..., Any], path: str | None = None) -> None:
        self._access = access
        rows, described = access("describe")
        columns = json.loads(described)
        self._rows: int = rows
        self.path: str | None = path
        """Path of the file from which the table was read; None for a table that was computed or selected."""
        self.columns: list[str] = [column["name"] for column in columns]
        """Names of the columns, including the units."""
        self.units: dict[str, str | None] = {column["name"]: column["unit"] for column in columns}
        """Units by column name, such as `m/s`; None for columns without a unit."""
        self.meanings: dict[str, str | None] = {
            column["name"]: column["meaning"] for column in columns
        }
        """Descriptions by column name; None for columns that trilink does not define."""

    def __len__(self) -> int:
        """Returns the number of rows."""
        return self._rows

    def __iter__(self) -> Iterator[str]:
        """Iterates over the names of the columns, as a dictionary of columns does."""
        return iter(self.columns)

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def keys(self) -> list[str]:
        """Returns the names of the columns, so that `dict(table)` is a dictionary of arrays.

        >>> import trilink
        >>> sorted(dict(trilink.read("trials", columns=["trial", "d_m"])))
        ['d_m', 'trial']
        """
        return list(self.columns)

    @overload
    def __getitem__(self, key: str) -> Array: ...
    @overload
    def __getitem__(self, key: slice | list[str] | tuple[str, ...]) -> Table: ...
    def __getitem__(self, key: str | slice | list[str] | tuple[str, ...]) -> Array | Table:
        if isinstance(key, slice):
            start, stop, step = key.indices(self._rows)
            if step != 1:
                raise ValueError(f"found a slice with step {step}, needed step 1")
            return Table(self._access("slice", start, max(stop - start, 0)))
        if not isinstance(key, str):
            names = list(key)
            for name in names:
                self._check(name)
            return Table(self._access("select", names))
        import numpy

        self._check(key)
        kind, values = self._access("column", key)
        if kind != "O":
            return numpy.frombuffer(values, dtype=kind)
        objects = numpy.empty(len(values), dtype=object)
        # Assigned at once, lists of the same length would become rows.
        for index, value in enumerate(values):
            objects[index] = value
        return objects

    def _check(self, name: object) -> None:
        if name not in self.columns:
            raise KeyError(f"found column {name!r}, needed one of {', '.join(self.columns)}")

    def head(self, rows: int = 5) -> Table:
        """Returns the first rows.

        >>> import trilink
        >>> len(trilink.read("trials").head(2))
        2
        """
        return self[: max(rows, 0)]

    def to_polars(self) -> polars.DataFrame:
        """Returns the table as a polars data frame, which shares its memory.

        >>> import trilink
        >>> trilink.read("fits").to_polars()["model"].to_list()
        ['skid', 'skid-roll']
        """
        import polars

        return polars.DataFrame(self)

    def to_pandas(self) -> pandas.DataFrame:
        """Returns the table as a pandas data frame.

        >>> import trilink
        >>> trilink.read("fits").to_pandas()["model"].to_list()
        ['skid', 'skid-roll']
        """
        import pandas

        if hasattr(pandas.DataFrame, "from_arrow"):
            return pandas.DataFrame.from_arrow(self)
        import pyarrow

        return pyarrow.table(self).to_pandas()

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Returns a PyCapsule with an Arrow stream of the table. `requested_schema` is ignored."""
        return self._access("stream")

    def __repr__(self) -> str:
        path = f" {self.path}" if self.path else ""
        return f"<trilink.Table{path}: {self._rows} rows, {len(self.columns)} columns>"

    def _repr_html_(self) -> str:
        """Shows the first rows in a notebook, with the units of the columns."""

        def cell(value: object) -> str:
            text = (
                f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)
            )
            return f"<td>{escape(text)}</td>"

        names = "".join(f"<th>{escape(name)}</th>" for name in self.columns)
        units = "".join(f"<th>{escape(self.units[name] or '')}</th>" for name in self.columns)
        shown = self.head(_SHOWN_ROWS)
        rows = zip(*(shown[name].tolist() for name in self.columns))
        body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
        size = f"<p>{self._rows} rows, {len(self.columns)} columns</p>"
        return f"<table><thead><tr>{names}</tr><tr>{units}</tr></thead><tbody>{body}</tbody></table>{size}"
