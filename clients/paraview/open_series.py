"""Opens a PVD that `softtwin export` wrote, coloured by stress with one colour scale over all its states.

    SOFTTWIN_SERIES=sweep.pvd paraview --script=clients/paraview/open_series.py

SOFTTWIN_ARRAY names another array (default: von_mises [MPa]).
"""

import importlib.util
import os
import xml.etree.ElementTree as xml

from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader


def colour_range(series, array):
    """Smallest and largest value of a point array over all files of a PVD."""
    folder = os.path.dirname(os.path.abspath(series))
    low, high = float("inf"), float("-inf")
    for entry in xml.parse(series).getroot().findall("./Collection/DataSet"):
        reader = vtkXMLUnstructuredGridReader()
        reader.SetFileName(os.path.join(folder, entry.get("file")))
        reader.Update()
        data = reader.GetOutput().GetPointData()
        values = data.GetArray(array)
        if values is None:
            names = ", ".join(data.GetArrayName(at) for at in range(data.GetNumberOfArrays()))
            raise SystemExit(f"{entry.get('file')}: expected the point array {array!r}, found {names}; name one in SOFTTWIN_ARRAY")
        found = values.GetRange(-1)
        low, high = min(low, found[0]), max(high, found[1])
    if low > high:
        raise SystemExit(f"{series}: expected a PVD with states, found none; `softtwin export MODEL --out NAME.pvd` writes one")
    return low, high


def main():
    from paraview import simple

    series = os.environ.get("SOFTTWIN_SERIES")
    if not series:
        raise SystemExit("set SOFTTWIN_SERIES to the PVD that is to be opened")
    array = os.environ.get("SOFTTWIN_ARRAY", "von_mises [MPa]")
    low, high = colour_range(series, array)
    reader = simple.PVDReader(FileName=os.path.abspath(series))
    display = simple.Show(reader)
    simple.ColorBy(display, ("POINTS", array))
    simple.GetColorTransferFunction(array).RescaleTransferFunction(low, high)
    display.SetScalarBarVisibility(simple.GetActiveViewOrCreate("RenderView"), True)
    simple.ResetCamera()
    simple.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    simple.Render()


if importlib.util.find_spec("paraview"):
    main()
