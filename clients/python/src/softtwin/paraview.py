"""A twin's surface as VTK data, for ParaView's programmable sources and for any other program with VTK's Python.

In ParaView (docs/paraview.md): Sources, Live Programmable Source, output vtkPolyData, with the script

    from softtwin.paraview import show
    show(self.GetOutputDataObject(0), "softtwin/finger/field", "/path/to/pneunet.twin")
"""

import os
from typing import Any, Dict, Optional, Tuple

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray

from .bus import Bus
from .model import Model
from .subscribe import Subscription, subscribe

_open: Dict[Tuple[str, str, int], Tuple[Subscription, Model]] = {}


def show(output: Any, topic: str, model: "os.PathLike[str] | str", timeout_s: float = 5.0, bus: Optional[Bus] = None) -> None:
    """Fills a `vtkPolyData` with the newest field of a topic: the deformed surface (mm) with all other fields as point data.

    Topic and model are opened at the first call and stay open. The topic must have all nodes or a node set of the model that covers the
    surface, with x, y and z. Raises `ValueError` when topic and model do not fit, `TwinSilent` when nothing comes.
    """
    key = (topic, os.fspath(model), id(bus))
    if key not in _open:
        _open[key] = (subscribe(topic, timeout_s=timeout_s, on_restart="continue", bus=bus), Model(model))
    subscription, known = _open[key]
    field = subscription.newest()
    missing = [axis for axis in "xyz" if axis not in field.names]
    if missing:
        raise ValueError(f"{topic}: the surface needs x, y and z, the field has {', '.join(field.names)}; ask for them in the scene")
    fill(output, {name: np.array(field[name]) for name in field.names}, known.triangles_in(field.node_set, field.header.node_count))


def fill(output: Any, fields: Dict[str, "np.ndarray[Any, Any]"], triangles: "np.ndarray[Any, Any]") -> None:
    """Fills a `vtkPolyData`: points from x, y, z; triangles as numbers of points; every other field as point data."""
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.stack([fields[axis] for axis in "xyz"], axis=1), deep=True))
    cells = vtkCellArray()
    corners = np.ascontiguousarray(triangles, np.int64)
    starts = np.arange(0, corners.size + 1, 3, dtype=np.int64)
    cells.SetData(numpy_to_vtkIdTypeArray(starts, deep=True), numpy_to_vtkIdTypeArray(corners.ravel(), deep=True))
    output.Initialize()
    output.SetPoints(points)
    output.SetPolys(cells)
    for name, values in fields.items():
        if name not in ("x", "y", "z"):
            array = numpy_to_vtk(values, deep=True)
            array.SetName(name)
            output.GetPointData().AddArray(array)
    if "von_mises" in fields:
        output.GetPointData().SetActiveScalars("von_mises")
