"""Writes the .xdmf and .h5 files with meshio (5.3) and, in the layout of DOLFINx, with h5py (3)."""

import os
import pathlib

import h5py
import meshio
import numpy as np

BRICK = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
MIXED = np.vstack([BRICK, [[0.5, 0.5, 2.0]]])
TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0],
                [0, 0, 0.5], [0.5, 0, 0.5], [0, 0.5, 0.5]], dtype=float)


def displacement(nodes, load):
    """Displacement at every node."""
    n = np.arange(nodes)
    return load * np.stack([0.1 * n, -0.05 * n, 0.01 * n * n], axis=1)


def stress(nodes, load):
    """Uniaxial along x: the von Mises stress is the load times the number of the node."""
    tensor = np.zeros((nodes, 3, 3))
    tensor[:, 0, 0] = load * np.arange(nodes)
    return tensor


def series():
    cells = [("hexahedron", np.arange(8).reshape(1, 8)), ("tetra", np.array([[4, 5, 6, 8], [4, 6, 7, 8]]))]
    with meshio.xdmf.TimeSeriesWriter("series.xdmf") as out:
        out.write_points_cells(MIXED, cells)
        for time in (0.5, 1.0):
            out.write_data(time, point_data={"u": displacement(9, time), "stress": stress(9, time)})


def compressed():
    data = {"displacement": displacement(10, 2.0), "von_mises": 2.0 * np.arange(10, dtype=np.float32)}
    mesh = meshio.Mesh(TET, [("tetra10", np.arange(10).reshape(1, 10))], point_data=data)
    meshio.write("gzip.xdmf", mesh, compression="gzip", compression_opts=9)


HEAD = """<?xml version="1.0"?>
<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>
<Xdmf Version="3.0" xmlns:xi="https://www.w3.org/2001/XInclude">
  <Domain>
    <Grid Name="mesh" GridType="Uniform">
      <Topology TopologyType="Hexahedron" NumberOfElements="1" NodesPerElement="8">
        <DataItem Dimensions="1 8" NumberType="Int" Format="HDF">fenics.h5:/Mesh/mesh/topology</DataItem>
      </Topology>
      <Geometry GeometryType="XYZ">
        <DataItem Dimensions="8 3" Format="HDF">fenics.h5:/Mesh/mesh/geometry</DataItem>
      </Geometry>
    </Grid>
"""
POINTER = "xpointer(/Xdmf/Domain/Grid[@GridType='Uniform'][1]/*[self::Topology or self::Geometry])"


def fenics():
    xml = HEAD
    with h5py.File("fenics.h5", "w", libver="latest") as out:
        packed = {"compression": "gzip", "shuffle": True}
        out.create_dataset("Mesh/mesh/topology", data=np.arange(8, dtype=np.int64).reshape(1, 8), chunks=(1, 8), **packed)
        out.create_dataset("Mesh/mesh/geometry", data=BRICK, chunks=(3, 3), **packed)
        for name, kind, function in (("u", "Vector", displacement), ("stress", "Tensor", stress)):
            xml += f'    <Grid Name="{name}" GridType="Collection" CollectionType="Temporal">\n'
            for time in (0.5, 1.0):
                values = function(8, time).reshape(8, -1)
                path = f"Function/{name}/{str(time).replace('.', '_')}"
                out.create_dataset(path, data=values, chunks=(5, values.shape[1]), **packed)
                xml += (f'      <Grid Name="{name}" GridType="Uniform">\n        <xi:include xpointer="{POINTER}" />\n'
                        f'        <Time Value="{time}" />\n        <Attribute Name="{name}" AttributeType="{kind}" Center="Node">\n'
                        f'          <DataItem Dimensions="8 {values.shape[1]}" Format="HDF">fenics.h5:/{path}</DataItem>\n'
                        "        </Attribute>\n      </Grid>\n")
            xml += "    </Grid>\n"
    with open("fenics.xdmf", "w", encoding="utf-8") as out:
        out.write(xml + "  </Domain>\n</Xdmf>\n")


os.chdir(pathlib.Path(__file__).parent)
series()
compressed()
fenics()
