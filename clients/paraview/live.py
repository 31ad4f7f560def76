"""A running twin in ParaView: a live source, coloured by stress.

    python -m pip install --target PLACE build/packages/softtwin-*.whl     # for any Python from 3.10, ParaView's too
    PYTHONPATH=PLACE SOFTTWIN_MODEL=models/pneunet/pneunet.twin paraview --script=clients/paraview/live.py

SOFTTWIN_TOPIC names another field topic (default: softtwin/finger/field).
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
