"""A running twin in ParaView: a live source, coloured by stress.

    PYTHONPATH=clients/python/src:$(python -c 'import iceoryx2, os; print(os.path.dirname(os.path.dirname(iceoryx2.__file__)))') \
    SOFTTWIN_LIBRARY=target/release/libcapi.so SOFTTWIN_MODEL=models/pneunet/pneunet.twin paraview --script=clients/paraview/live.py

SOFTTWIN_TOPIC names another field topic (default: softtwin/finger/field). ParaView's Python must be of the version that iceoryx2 was installed for.
"""

import os

from paraview import simple

topic = os.environ.get("SOFTTWIN_TOPIC", "softtwin/finger/field")
model = os.path.abspath(os.environ.get("SOFTTWIN_MODEL", "models/pneunet/pneunet.twin"))
source = simple.LiveProgrammableSource(OutputDataSetType="vtkPolyData")
source.Script = f"""
from softtwin.paraview import show
show(self.GetOutputDataObject(0), {topic!r}, {model!r})
"""
source.CheckNeedsUpdateScript = "self.SetNeedsUpdate(True)"
display = simple.Show(source)
simple.ColorBy(display, ("POINTS", "von_mises"))
simple.GetColorTransferFunction("von_mises").AutomaticRescaleRangeMode = "Grow and update every timestep"
simple.ResetCamera()
simple.Render()
