"""Draws arm.step, as a CAD program would export it: `pip install gmsh`, then `python arm.py arm.step`."""
import re
import sys
from pathlib import Path

import gmsh

gmsh.initialize()
occ = gmsh.model.occ
body = [(3, occ.addBox(0, 0, 0, 120, 20, 20))]
upper = occ.addBox(4, 12, 4, 112, 4, 12)
left, right = (occ.addBox(4 + k, 4, z, 112, 5, 4.5) for k, z in ((0.5, 3.5), (1, 12)))
occ.cut(body, [(3, chamber) for chamber in (upper, left, right)])
occ.synchronize()
gmsh.write(sys.argv[1])
# gmsh leaves its own name in place of the body's.
path = Path(sys.argv[1])
path.write_text(re.sub(r"'Open CASCADE STEP translator [\d.]+ 1'", "'silicone'", path.read_text()))
