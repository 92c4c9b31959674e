"""Figures that the report, or a command, has drawn."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from . import _trilink
from ._table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure


class Figure:
    """Figure as SVG, which a notebook shows; figures of the report also as PNG and PDF, with the plotted data.

    >>> import trilink
    >>> figure = trilink.report().figures["fig10"]
    >>> figure.svg.startswith("<svg"), figure.png[1:4]
    (True, b'PNG')
    >>> list(figure.data)[:3]
    ['panel', 'campaign', 'series']
    """

    def __init__(self, svg: Path, *, is_of_report: bool = False) -> None:
        self.name: str = svg.stem
        """Name of the figure, such as `fig13` (as in the paper) or `work`."""
        self.svg: str = svg.read_text(encoding="utf-8")
        """The figure as SVG."""
        self._path = svg if is_of_report else None

    def _file(self, ending: str) -> Path:
        if self._path is None:
            raise AttributeError(
                f"figure {self.name}: found only SVG, needed a figure of the report"
            )
        return self._path.with_suffix(f".{ending}")

    @property
    def png(self) -> bytes:
        """The figure as PNG with 350 dots per inch."""
        return self._file("png").read_bytes()

    @property
    def pdf(self) -> bytes:
        """The figure as PDF."""
        return self._file("pdf").read_bytes()

    @property
    def data(self) -> Table:
        """Plotted data: a row for each point; a column `*_error_95` has the half widths of error bars."""
        with self._file("csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        names = list(rows[0]) if rows else []
        return Table(
            _trilink.table([(name, _column([row[name] for row in rows])) for name in names])
        )

    def plot(self) -> MatplotlibFigure:
        """Draws the plotted data with matplotlib: each panel, its layers with error bars, and the bands.

        >>> import trilink
        >>> drawn = trilink.report().figures["fig10"].plot()
        >>> [axes.get_xlabel() for axes in drawn.axes]
        ['omega_rad_s', 'omega_rad_s']
        """
        import numpy
        from matplotlib.figure import Figure as MatplotlibFigure

        data = self.data
        panels = list(dict.fromkeys(data["panel"]))
        names = numpy.array([str(name) for name in data[_layer_column(data)]])
        drawn = MatplotlibFigure(figsize=(6, 3 * len(panels)), layout="constrained")
        for axes, panel in zip(drawn.subplots(len(panels), squeeze=False)[:, 0], panels):
            inside = data["panel"] == panel
            x, *measures = [
                name
                for name in data
                if data[name].dtype == float and numpy.isfinite(data[name][inside]).any()
            ]
            measures = [name for name in measures if not name.endswith(_BOUNDS)]
            for layer in dict.fromkeys(names[inside]):
                for y in measures:
                    rows = inside & (names == layer) & numpy.isfinite(data[x] + data[y])
                    at, value = data[x][rows], data[y][rows]
                    if (
                        f"{y}_error_95" in data
                        and numpy.isfinite(data[f"{y}_error_95"][rows]).any()
                    ):
                        axes.errorbar(at, value, data[f"{y}_error_95"][rows], fmt="o", label=layer)
                    elif rows.any():
                        [line] = axes.plot(at, value, label=layer)
                        if f"{y}_lo" in data:
                            low, high = data[f"{y}_lo"][rows], data[f"{y}_hi"][rows]
                            axes.fill_between(at, low, high, alpha=0.25, color=line.get_color())
            title = data["title"][inside][0] if "title" in data else ""
            axes.set(xlabel=x, ylabel=", ".join(measures), title=title)
            axes.legend(fontsize="small")
        if "origin" in data:
            drawn.supxlabel("Synthetic trials, not recorded", fontsize="small")
        return drawn

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f"<trilink.Figure {self.name}>"


_BOUNDS = ("_error_95", "_lo", "_hi")


def _column(texts: list[str]) -> list[float | None] | list[str]:
    """Converts the texts of a column to numbers if all of them are numbers or empty."""
    try:
        return [float(text) if text else None for text in texts]
    except ValueError:
        return texts


def _layer_column(data: Table) -> str:
    return "layer" if "layer" in data else "series"
