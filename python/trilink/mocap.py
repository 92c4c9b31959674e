"""Marker files of motion-capture systems."""

from __future__ import annotations

import os

from . import _trilink
from ._call import Pathlike, caution
from ._table import Table

__all__ = ["read"]


def read(path: Pathlike, *, unit: str = "mm") -> Table:
    """Reads the markers of a file of any known format (CSV of Vicon or OptiTrack, Qualisys TSV, TRC, C3D; plain or
    gzipped) as a table with a row for each frame and marker: `frame`, `time_s`, `marker`, `x_mm`, `y_mm`, `z_mm`.

    Nothing is interpolated: coordinates of an occluded marker are NaN. The times begin at the first frame; they are NaN
    if the file states no frame rate. The third axis points up.

    path: path of the file.
    unit: unit of length, mm, cm, m or in, if the file does not state one.

    >>> import trilink.mocap
    >>> markers = trilink.mocap.read("raw/demo/kinematic-skewed-2.00-r1.csv")
    >>> markers.columns
    ['frame', 'time_s', 'marker', 'x_mm', 'y_mm', 'z_mm']
    >>> one = markers.to_polars().filter(marker="Snake:M1")
    >>> one.height == len(set(markers["frame"]))
    True
    """
    access, doubts = _trilink.markers(os.fspath(path), unit)
    for doubt in doubts:
        caution(f"{os.fspath(path)}: {doubt}")
    return Table(access, os.fspath(path))
