"""`softtwin-convert` on files of other programs: XDMF, FEBio's plot files, Ansys' archives and listings, Abaqus' reports, reduced-order models."""

import json
import pathlib
import random
import struct
import subprocess
import zlib

import mapdl_archive
import mapdl_archive.examples
import meshio
import numpy as np
import pytest
import pyvista
from conftest import PROGRAMS
from softtwin.convert import Refused, main, read
from softtwin.convert.run import CELLS, SIZES

DATA = pathlib.Path(__file__).parent / "data"
KINDS = {"linear": ["hexahedron", "wedge", "pyramid", "tetra"], "quadratic": ["hexahedron20", "wedge15", "pyramid13", "tetra10"]}


def displacement(nodes, load):
    n = np.arange(nodes)
    return load * np.stack([0.1 * n, -0.05 * n, 0.01 * n * n], axis=1)


def counts(run):
    return {kind: len(nodes) for kind, nodes in run.cells.items()}


def imported(folder, name, *options):
    """Report of `softtwin import results` on a converted file."""
    command = [PROGRAMS / "softtwin", "import", "results", name, "--out", "db", "--length-unit", "mm", "--stress-unit", "mpa", "--json"]
    done = subprocess.run([*command, *options], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# XDMF


def test_a_series_of_meshio_has_mixed_cells_and_both_states():
    run = read(DATA / "series.xdmf")
    assert counts(run) == {"hexahedron": 1, "tetra": 2} and run.points[8].tolist() == [0.5, 0.5, 2.0]
    assert [time for time, _ in run.states] == [0.5, 1.0]
    for time, values in run.states:
        np.testing.assert_allclose(values["u"], displacement(9, time), atol=1e-12)
        assert values["stress"].shape == (9, 9) and values["stress"][8, 0] == 8 * time


def test_a_compressed_grid_of_meshio_is_one_state():
    run = read(DATA / "gzip.xdmf")
    assert counts(run) == {"tetra10": 1} and len(run.points) == 10 and [time for time, _ in run.states] == [None]
    np.testing.assert_allclose(run.states[0][1]["displacement"], displacement(10, 2.0), atol=1e-12)
    assert run.states[0][1]["von_mises"][9] == 18.0


def test_collections_of_fenics_are_one_series_that_becomes_a_database(tmp_path):
    run = read(DATA / "fenics.xdmf")
    assert counts(run) == {"hexahedron": 1} and [time for time, _ in run.states] == [0.5, 1.0]
    np.testing.assert_allclose(run.states[1][1]["u"], displacement(8, 1.0), atol=1e-12)
    assert run.states[1][1]["stress"][7, 0] == 7.0
    assert main([str(DATA / "fenics.xdmf"), "--out", str(tmp_path / "fenics.npz")]) == 0
    found = imported(tmp_path, "fenics.npz", "--steps", "all", "--ramp", "load_n=3")
    assert (found["states"], found["nodes"], found["inputs"]) == (2, 8, ["load_n"])
    rows = (tmp_path / "db/cases.csv").read_text().splitlines()[1:]
    assert [row.split(",")[5] for row in rows] == ["1.5", "3"]


def altered(tmp_path, name, *changes):
    """A copy with its .h5, with replacements in the text."""
    text = (DATA / name).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / name).write_text(text)
    h5 = pathlib.Path(name).with_suffix(".h5")
    (tmp_path / h5).write_bytes((DATA / h5).read_bytes())
    return tmp_path / name


def test_collections_of_other_times_are_refused(tmp_path):
    with pytest.raises(Refused, match="Grid stress"):
        read(altered(tmp_path, "fenics.xdmf", ('<Time Value="1.0" />', '<Time Value="2.0" />')))


POINTS = "0 0 0 1 0 0 0 1 0 0 0 1"


def grid(inner, topology="Tetrahedron", cells="0 1 2 3", points=POINTS):
    return (
        f'<Xdmf><Domain><Grid Name="a"><Geometry GeometryType="XYZ"><DataItem Dimensions="{len(points.split()) // 3} 3" Format="XML">{points}'
        f'</DataItem></Geometry><Topology TopologyType="{topology}"><DataItem Dimensions="{len(cells.split())}" Format="XML">{cells}'
        f"</DataItem></Topology>{inner}</Grid></Domain></Xdmf>"
    )


def attribute(name, values, more=""):
    return f'<Attribute Name="{name}" {more}><DataItem Dimensions="{len(values.split())}" Format="XML">{values}</DataItem></Attribute>'


def xdmf(tmp_path, text):
    (tmp_path / "run.xdmf").write_text(text)
    return read(tmp_path / "run.xdmf")


def test_inline_and_binary_numbers_and_references_are_read(tmp_path):
    values = np.arange(12.0)
    (tmp_path / "u.bin").write_bytes(bytes(7) + values.astype(">f4").tobytes())
    (tmp_path / "v.bin").write_bytes(values.astype("<f8").tobytes())
    binary = '<Attribute Name="{}"><DataItem Dimensions="4 3" Format="Binary" {}>{}</DataItem></Attribute>'
    inner = (
        attribute("s", "1 2.5 -3e1 4")
        + binary.format("u", 'Endian="Big" Seek="7"', "u.bin")
        + binary.format("v", 'DataType="Float" Precision="8"', " v.bin ")
        + '<Attribute Name="w"><DataItem Reference="XML"> /Xdmf/Domain/Grid/Attribute[@Name="v"]/DataItem </DataItem></Attribute>'
        + attribute("e", "1", 'Center="Cell"')
        + attribute("T", "1 2 3 4 5 6 " * 4, 'AttributeType="Tensor6"')
    )
    run = xdmf(tmp_path, grid(inner))
    ((_, found),) = run.states
    assert found["s"].tolist() == [1.0, 2.5, -30.0, 4.0] and set(found) == {"s", "u", "v", "w"}
    assert all(found[name].ravel().tolist() == values.tolist() for name in "uvw")
    assert [reason.split(":")[0] for reason in run.left_out] == ["e", "T"]
    (tmp_path / "v.bin").write_bytes(bytes(95))
    with pytest.raises(Refused, match="11 numbers"):
        read(tmp_path / "run.xdmf")


@pytest.mark.parametrize(
    ("name", "nodes", "kind"),
    [
        ("Tetrahedron", 4, "tetra"), ("Tetrahedron_10", 10, "tetra10"), ("Hexahedron", 8, "hexahedron"), ("Hex_20", 20, "hexahedron20"),
        ("HEXAHEDRON_27", 27, "hexahedron20"), ("Wedge", 6, "wedge"), ("Wedge_15", 15, "wedge15"),
    ],
)  # fmt: skip
def test_cells_by_name(tmp_path, name, nodes, kind):
    points = " ".join(f"{n} 0 0" for n in range(nodes))
    run = xdmf(tmp_path, grid("", name, " ".join(map(str, range(nodes))), points))
    assert run.cells[kind].tolist() == [list(range(SIZES[kind]))] and not run.states


def test_mixed_cells_between_points_and_lines(tmp_path):
    points = " ".join(f"{n} 0 0" for n in range(6))
    run = xdmf(tmp_path, grid("", "Mixed", "6 0 1 2 3 1 1 0 2 2 0 1 34 0 1 2 8 0 1 2 3 4 5 6 1 2 3 4", points))
    assert counts(run) == {"tetra": 2, "wedge": 1}
    for topology, cells in [("Pyramid", "0 1 2 3 4"), ("Mixed", "7 0 1 2 3 4"), ("Mixed", "6 0 1 2 3 9 0 1"), ("Tetrahedron", "0 1 2 6"), ("Tetrahedron", "0 1 2 3 4")]:
        with pytest.raises(Refused):
            xdmf(tmp_path, grid("", topology, cells, points))


def test_times_of_a_list(tmp_path):
    single = grid(attribute("u", "0 0 0 0"))
    inner = single[single.index("<Grid") : single.index("</Domain>")]
    series = '<Xdmf><Domain><Grid GridType="Collection" CollectionType="Temporal">{}' + inner * 2 + "</Grid></Domain></Xdmf>"
    time = '<Time TimeType="{}"><DataItem Dimensions="{}" Format="XML">{}</DataItem></Time>'
    assert [t for t, _ in xdmf(tmp_path, series.format(time.format("List", 2, "0.25 1"))).states] == [0.25, 1.0]
    assert [t for t, _ in xdmf(tmp_path, series.format(time.format("HyperSlab", 3, "1 0.5 2"))).states] == [1.0, 1.5]
    with pytest.raises(Refused, match="undeformed mesh"):
        xdmf(tmp_path, series.format("").replace(POINTS, "0 0 0 2 0 0 0 1 0 0 0 1", 1))


GOOD = grid(attribute("u", POINTS))


@pytest.mark.parametrize(
    "text",
    [
        GOOD[:-7], "<VTKFile/>", "no XML", "<Xdmf><Domain/></Xdmf>", GOOD.replace("<Grid", '<Grid GridType="Collection" CollectionType="Spatial"'),
        GOOD.replace("4 3", "5 3"), GOOD.replace('"4 3"', '"4 x"'), GOOD.replace('"4 3"', '"9223372036854775808 3"'), grid(attribute("u", "1 2 3 4 5")),
        GOOD.replace("<Attribute", '<Attribute ItemType="FiniteElementFunction"'), GOOD.replace("XYZ", "VXVYVZ"),
        GOOD.replace("<Topology", '<Topology Reference="/Xdmf/Nowhere"'), GOOD.replace("<DataItem", '<DataItem ItemType="HyperSlab"'),
        grid('<Attribute Name="u" Reference="/Xdmf/Domain/Grid/Attribute"/>'), GOOD.replace('"XML">0 0 0', '"HDF">no.h5:/u', 1),
    ],
)  # fmt: skip
def test_invalid_xdmf_is_refused(tmp_path, text):
    assert read(altered(tmp_path, "gzip.xdmf"))
    with pytest.raises((Refused, ValueError)):
        xdmf(tmp_path, text)


def test_hdf5_that_is_cut_short_is_refused(tmp_path, capsys):
    path = altered(tmp_path, "gzip.xdmf")
    whole = path.with_suffix(".h5").read_bytes()
    for eighth in range(8):
        path.with_suffix(".h5").write_bytes(whole[: len(whole) * eighth // 8])
        with pytest.raises(Refused):
            read(path)
        with pytest.raises(SystemExit) as ended:
            main([str(path)])
        assert "gzip.xdmf" in ended.value.code and not path.with_suffix(".npz").exists()


# FEBio


def test_converged_states_of_febio_have_means_at_the_nodes():
    run = read(DATA / "plain.xplt")
    assert counts(run) == {"hexahedron": 2, "wedge": 1, "tetra10": 1} and run.points[13].tolist() == [1.0, 0.5, 3.0] and len(run.points) == 29
    assert [time for time, _ in run.states] == [0.0, 0.5, 1.0] and len(run.left_out) == 1
    _, last = run.states[2]
    np.testing.assert_allclose(last["displacement"][28], np.float32([2.8, -1.4, 7.84]))
    # Nodes of one element, of two in one region, of two regions, of the tetrahedron with an inner node.
    assert last["stress"][[0, 4, 8, 13, 28], 0].tolist() == [1.0, 1.5, 2.0, 2.0, 3.0]
    half = run.states[1][1]
    assert half["density"].tolist() == [10.0 * n for n in range(29)] and half["own flux"][:, 0].tolist() == list(range(29))
    assert half["own flux"][4, 1:].tolist() == [0.0, 0.5] and half["own flux"][8, 1] == 0.5
    assert "strain energy" not in half  # one number per domain


def same(a, b):
    assert [time for time, _ in a.states] == [time for time, _ in b.states] and a.left_out == b.left_out and counts(a) == counts(b)
    for (_, one), (_, other) in zip(a.states, b.states):
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])


def test_compressed_states_and_the_other_byte_order_are_the_same(tmp_path):
    plain = read(DATA / "plain.xplt")
    same(plain, read(DATA / "compressed.xplt"))
    words = (DATA / "plain.xplt").read_bytes()
    (tmp_path / "big.xplt").write_bytes(np.frombuffer(words, "<u4").astype(">u4").tobytes())
    swapped = read(tmp_path / "big.xplt")  # names are swapped too
    assert len(swapped.states) == 3 and counts(swapped) == counts(plain) and (swapped.points == plain.points).all()


@pytest.mark.parametrize("name", ["plain.xplt", "compressed.xplt"])
def test_a_plot_file_that_is_cut_short_keeps_its_whole_states(tmp_path, name):
    (tmp_path / name).write_bytes((DATA / name).read_bytes()[:-10])
    run = read(tmp_path / name)
    assert len(run.states) == 2 and run.left_out[1].startswith("state 4")


@pytest.mark.parametrize(
    ("words", "offset", "word"),
    [
        ([0x01010001, 4, 0x34], 2, 8),  # version 0.8
        ([0x01042102, 4, 8], 2, 14),  # tet20
        ([0x01042201, 36, 1], 3, 99),  # a node beyond the last
        ([0x01042201, 36, 1], 3, 1),  # a node twice in an element
        ([0x01041101, 4, 29], 2, 28),  # a node fewer than coordinates
        ([0x02020002, 4, 2], 2, 3),  # a quantity beyond the dictionary
        ([0x01020002, 4, 1], 2, 2),  # a vector with the size of a tensor
    ],
)
def test_inconsistent_plot_files_are_refused(tmp_path, words, offset, word):
    data = bytearray((DATA / "plain.xplt").read_bytes())
    at = data.index(struct.pack(f"<{len(words)}I", *words)) + 4 * offset
    data[at : at + 4] = struct.pack("<I", word)
    (tmp_path / "run.xplt").write_bytes(data)
    with pytest.raises(Refused):
        read(tmp_path / "run.xplt")


def test_states_of_febio_become_a_database(tmp_path):
    assert main([str(DATA / "compressed.xplt"), "--out", str(tmp_path / "ramp.npz")]) == 0
    found = imported(tmp_path, "ramp.npz", "--steps", "all", "--ramp", "load_n=4")
    assert (found["states"], found["nodes"], found["fields"][-1]) == (3, 24, "von_mises")  # nodes within faces and the tetrahedron have no cell


# Ansys


@pytest.mark.parametrize("name", ["linear", "quadratic"])
def test_collapsed_hexahedra_become_the_cells_that_they_are(tmp_path, name):
    run = read(DATA / f"{name}.cdb")
    assert list(run.cells) == KINDS[name] and run.points[1].tolist() == [1.0, 0.0, 0.0]
    assert main([str(DATA / f"{name}.cdb"), "--out", str(tmp_path / "mesh.vtu")]) == 0
    mesh = pyvista.read(tmp_path / "mesh.vtu")
    assert abs(mesh.volume - (1 + 1 / 2 + 1 / 3 + 1 / 6)) < 1e-6 and mesh.n_cells == 4


def test_archives_agree_with_mapdl_archive():
    """Cells of the archives that come with it, node by node."""
    for path in sorted(pathlib.Path(mapdl_archive.examples.__file__).parent.glob("*.cdb")):
        theirs = mapdl_archive.Archive(str(path)).grid
        run = read(path)
        assert sum(counts(run).values()) == theirs.n_cells, path.name
        for kind in run.cells:
            part = theirs.extract_cells(theirs.celltypes == CELLS[kind][1])
            places = np.array([cell.points for cell in part.cell])
            mine = run.points[run.cells[kind]]
            if kind == "wedge":  # which triangle is first differs
                places, mine = (np.array([cell[np.lexsort(cell.T)] for cell in cells]) for cells in (places, mine))
            assert np.abs(places - mine).max() < 1e-5, path.name


MODEL = (DATA / "model.cdb").read_text()


def test_blocks_in_both_forms_and_elements_without_a_body(tmp_path):
    run = read(DATA / "model.cdb")
    assert run.points[3].tolist() == [0.0, 0.0, 1.0]
    assert {kind: nodes.tolist() for kind, nodes in run.cells.items()} == {"tetra10": [list(range(10))], "triangle": [[0, 2, 1]]}
    assert len(run.left_out) == 1 and "174" in run.left_out[0]
    unsolid = MODEL.replace("et,3,shell181", "et,3,solid186").replace("        9        1        1        1        0        1        3        2        2",
        f"{9:9}{1:9}{1:9}{1:9}{0:9}" + "".join(f"{n:9}" for n in (1, 2, 3, 3, 999, 999, 999, 999, 5, 6)) + "\n" + "".join(f"{n:9}" for n in (3, 7, 999, 999, 999, 999, 8, 9, 10, 10)))  # fmt: skip
    (tmp_path / "run.cdb").write_text(unsolid)
    assert read(tmp_path / "run.cdb").cells["tetra10"].tolist() == [list(range(10))] * 2
    text = MODEL.replace("        5        6        3        7      999", "        0        0        3        0      999")
    (tmp_path / "run.cdb").write_text(text.replace("        8        9       10       10\n", "        0        0        0        0\n"))
    assert list(read(tmp_path / "run.cdb").cells) == ["tetra", "triangle"]  # without any mid-side


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("ET,        1,186", "ET,_T,186", "line 4"),
        ("ET,2,CONTA174\n", "", "line 24, element 8"),
        ("        8        9       10       10\n", "        8        9       11       10\n", r"element 7.*\[11\]"),
        ("        5        6        3", "        0        6        3", "element 7.*EMID"),
        ("        3        3      999", "        3        2      999", "element 7"),
        ("        2        0        0 1.0", "        1        0        0 1.0", r"\[1\]"),
        ("(3i9,6e21.13e3)", "1 2 3", "line 9"),
        (" 1.0000000000000E+000\n", " 1.00000_000A000E+000\n", "line 11"),
        ("NBLOCK,6", "NB,6", "nodes of NBLOCK|NBLOCK with nodes"),
    ],
)
def test_damaged_archives_are_refused_with_their_place(tmp_path, old, new, place):
    assert old in MODEL
    (tmp_path / "run.cdb").write_text(MODEL.replace(old, new, 1))
    with pytest.raises(Refused, match=place):
        read(tmp_path / "run.cdb")


def test_archives_without_blocks_or_cut_short_are_refused(tmp_path):
    for text in (MODEL[: MODEL.index("N,R5.3")], "/PREP7\nET,1,187\nN,R5.3,LOC,       1,  0.0,  0.0,  0.0\n", "a song\n"):
        (tmp_path / "run.cdb").write_text(text)
        with pytest.raises(Refused):
            read(tmp_path / "run.cdb")


def listings():
    """Output of PRNSOL,U and PRNSOL,S for the tetrahedron of MODEL: stresses at corners only."""
    text = ""
    for substep, load in ((1, 0.5), (2, 1.0)):
        head = lambda what, of: (
            f" PRINT {what}    NODAL SOLUTION PER NODE\n \n  ***** POST1 NODAL {of} LISTING *****\n \n  LOAD STEP=     1  SUBSTEP=     {substep}\n"
            f"   TIME=   {load:.4f}      LOAD CASE=   0\n \n"
        )
        text += "1          ***** ANSYS - ENGINEERING ANALYSIS SYSTEM  RELEASE 14.0 *****\n" + head("U", "DEGREE OF FREEDOM")
        text += "  THE FOLLOWING DEGREE OF FREEDOM RESULTS ARE IN THE GLOBAL COORDINATE SYSTEM\n \n    NODE       UX           UY           UZ           USUM\n"
        for node in (1, 2, 3, 5, 6, 7, 8, 9, 10, 999):
            u = load * node
            text += f"{node:8}  {u:.5f}     -{u:.5f}E-002-{u:.5f}E-003  0.0000\n"
        text += "\n MAXIMUM ABSOLUTE VALUES\n NODE        999        999        999        999\n VALUE   999.00     -999.00E-002-1.E-003  0.0000\n \n"
        text += head("S", "STRESS") + "  THE FOLLOWING X,Y,Z VALUES ARE IN GLOBAL COORDINATES\n \n    NODE     SX           SY           SZ           SXY          SYZ          SXZ\n"
        for node in (1, 2, 3, 999):
            text += f"{node:8}   {load * node:.5f}     0.0000      0.0000      0.0000      0.0000     -0.0000\n"
        text += "\n MINIMUM VALUES\n NODE          1          1          1          1          1          1\n VALUE    1.0 0.0 0.0 0.0 0.0 0.0\n"
    return text


def job(tmp_path, **results):
    (tmp_path / "run.cdb").write_text(MODEL)
    for ending, text in results.items():
        (tmp_path / f"run.{ending}").write_text(text)
    return tmp_path / "run.cdb"


def test_listings_of_prnsol_become_states_with_stress_at_the_mid_sides(tmp_path):
    run = read(job(tmp_path, txt=listings()))
    assert [time for time, _ in run.states] == [0.5, 1.0]
    np.testing.assert_allclose(run.states[0][1]["U"][1], [1.0, -0.01, -0.001])
    assert run.states[1][1]["S"][:, 0].tolist() == [1.0, 2.0, 3.0, 999.0, 1.5, 2.5, 2.0, 500.0, 500.5, 501.0]


def test_tables_have_their_components_in_order(tmp_path):
    rows = "".join(f"{node},1,4,0.1,0.2,{node},1,2,3,5,6,7\n" for node in (1, 2, 3, 5, 6, 7, 8, 9, 10, 999))
    table = "NODE,STEP,SXY,UX,UY,UZ,SX,SY,SZ,SYZ,SXZ,energy\n" + rows
    ((_, values),) = read(job(tmp_path, csv=table)).states
    assert values["U"][3].tolist() == [0.1, 0.2, 999.0] and values["S"][0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0] and values["energy"].shape == (10,)
    (tmp_path / "run.lis").write_text("")
    with pytest.raises(Refused, match="run.csv and .*run.lis"):
        read(tmp_path / "run.cdb")


def test_zeros_of_ansys_at_mid_sides_are_filled(tmp_path):
    value = {1: 1.0, 2: 1.0, 3: 1.0, 999: 4.0}
    table = "node,seqv\n" + "".join(f"{node},{value.get(node, 0)}\n" for node in (1, 2, 3, 5, 6, 7, 8, 9, 10, 999))
    ((_, values),) = read(job(tmp_path, csv=table)).states
    assert values["seqv"].tolist() == [1.0, 1.0, 1.0, 4.0, 1.0, 1.0, 1.0, 2.5, 2.5, 2.5]


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("ARE IN THE GLOBAL COORDINATE SYSTEM", "ARE IN COORDINATE SYSTEM   11", "RSYS,0"),
        ("       2  1.0", "       4  1.0", "found 4"),
        ("       3  1.5", "       2  1.5", "node 2 again"),
        ("TIME=   0.5000", "FREQ=   0.5000", "line 7"),
        ("     0.0000      0.0000", " ******* 0.0000", "6 numbers"),
        ("    NODE       UX ", "    KNOTEN     UX ", "line 12"),
    ],
)
def test_invalid_listings_are_refused(tmp_path, old, new, place):
    with pytest.raises(Refused, match=place):
        read(job(tmp_path, txt=listings().replace(old, new, 1)))


# Abaqus

INP = "*NODE\n11,0,0,0\n12,1,0,0\n13,0,1,0\n14,0,0,1\n*ELEMENT,TYPE=C3D4\n1,11,12,13,14\n"


def report(step, increment, time, factor):
    rows = "".join(
        f"{node:>16} {0.1 * u:>15.6E} {-0.2 * u:>15.6E} {0.3 * u:>15.6E} {1 + u:>15.6E}\n" for node in range(11, 15) for u in [factor * (node - 11)]
    )
    return (
        f"{'*' * 80}\nField Output Report, written Tue Nov 24 10:11:12 2026\n\nSource 1\n---------\n\n   ODB: C:/temp/run.odb\n   Step: {step}\n"
        f"   Frame: Increment {increment:>6}: Step Time = {time:>8.4f}\n\nLoc 1 : Nodal values from source 1\n\nOutput sorted by column \"Node Label\".\n\n"
        "Field Output reported at nodes for part: PART-1-1\n\n            Node            U.U1            U.U2            U.U3         S.Mises\n"
        f"           Label          @Loc 1          @Loc 1          @Loc 1          @Loc 1\n{'-' * 79}\n{rows}\n\n"
        "  Minimum          0.             -1.              0.              1.\n      At Node              11              14              11              11\n\n"
        "  Total            1.              2.              3.              4.\n\n\n"
    )


def test_a_field_report_becomes_the_table_of_its_mesh(tmp_path):
    text = report("Step-1", 5, 0.5, 1.0) + report("Step-1", 9, 1.0, 2.0) + report("Step-2", 1, 0.25, 3.0)
    (tmp_path / "run.inp").write_text(INP)
    (tmp_path / "run.rpt").write_text(text)
    assert main([str(tmp_path / "run.rpt")]) == 0
    rows = [row.split(",") for row in (tmp_path / "run.csv").read_text().splitlines()]
    assert rows[0] == ["node", "step", "time", "U1", "U2", "U3", "Mises"] and len(rows) == 13
    assert list(dict.fromkeys((row[1], row[2]) for row in rows[1:])) == [("1 substep 5", "0.5"), ("1 substep 9", "1.0"), ("2 substep 1", "0.25")]
    np.testing.assert_allclose([float(v) for v in rows[8][3:]], [0.6, -1.2, 1.8, 7.0])
    assert imported(tmp_path, "run.inp", "--ramp", "load_n=1")["nodes"] == 4
    for new in ("              13 ", "no"):
        (tmp_path / "run.rpt").write_text(text.replace("              14 ", new, 1) if new != "no" else "nothing")
        with pytest.raises(SystemExit):
            main([str(tmp_path / "run.rpt")])


# Reduced-order models


def binary(values):
    values = np.asarray(values, "<f8").ravel()
    return struct.pack("<Q", values.size) + values.tobytes()


@pytest.fixture
def exchange(tmp_path):
    """Four nodes in m; state k moves all by (0, -k, 0) mm and stresses node n with n + k MPa."""
    folder = tmp_path / "part"
    points = 1e-3 * np.arange(12.0)
    settings = {
        "displacement": {"name": "displacement", "unit": "m", "deformation": True, "dimensionality": [3], "ids": [1, -1, 4]},
        "stress": {"name": "stress", "unit": "Pa", "deformation": False, "dimensionality": [1]},
    }
    for name, setting in settings.items():
        (folder / name / "snapshots").mkdir(parents=True)
        (folder / name / "settings.json").write_text(json.dumps(setting))
        (folder / name / "points.bin").write_bytes(binary(points))
        (folder / name / "doe.csv").write_text(f"{name},pressure[kPa],gap[mm],contact_force[N],split\nfile0.bin,10,,,\nfile1.bin,50,40,0.25,test\n")
        for state in range(2):
            values = np.tile([0, -1e-3 * state, 0], 4) if name == "displacement" else 1e6 * (np.arange(4) + state)
            (folder / name / f"snapshots/file{state}.bin").write_bytes(binary(values))
    return folder


def test_snapshots_of_reduced_order_models_become_a_database(exchange, tmp_path):
    assert main([str(exchange)]) == 0
    out = tmp_path / "part-database"
    rows = [row.split(",") for row in (out / "cases.csv").read_text().splitlines()]
    assert rows[1] == ["file0", "free", "train", "0.01", "", "0"] and rows[2] == ["file1", "contact", "test", "0.05", "40.0", "0.25"]
    found = np.load(out / "snapshots.npy")[1]
    expected = np.column_stack([np.arange(12.0).reshape(4, 3) - [0, 1, 0], np.ones(4), np.arange(4) + 1.0])
    np.testing.assert_allclose(found, expected, atol=1e-5)
    done = subprocess.run([PROGRAMS / "softtwin", "export", out, "--out", tmp_path / "all.npy"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(np.load(tmp_path / "all.npy")[1], found)


def test_a_symmetric_stress_becomes_von_mises(exchange, tmp_path):
    settings = {"name": "s", "unit": "MPa", "dimensionality": [3, 3], "symmetricalDim": True}
    (exchange / "stress/settings.json").write_text(json.dumps(settings))
    for state, tensor in enumerate(([2.0, 0, 0, 0, 0, 0], [5.0, 5, 5, 0, 1, 0])):
        (exchange / f"stress/snapshots/file{state}.bin").write_bytes(binary(np.tile(tensor, 4)))
    assert main([str(exchange)]) == 0
    np.testing.assert_allclose(np.load(tmp_path / "part-database/snapshots.npy")[:, :, 4], [[2.0] * 4, [3.0**0.5] * 4], rtol=1e-6)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("stress/settings.json", '{"name":"heat","unit":"W","dimensionality":[2]}'),
        ("stress/settings.json", '{"name":"s","unit":"bananas","dimensionality":[1]}'),
        ("stress/settings.json", '{"name":"s","unit":"Pa","unitFactor":2.0,"dimensionality":[1]}'),
        ("stress/settings.json", '{"name":"u","unit":"m","deformation":true,"dimensionality":[3]}'),
        ("stress/snapshots/file1.bin", binary([1.0] * 3)),
        ("stress/snapshots/file0.bin", None),
        ("displacement/doe.csv", "displacement,flow[l/min]\nfile0.bin,1\n"),
        ("displacement/doe.csv", "displacement,pressure[kPa]\nfile0.bin,much\n"),
        ("displacement/doe.csv", "displacement,pressure[kPa]\n../../x.bin,1\n"),
        ("displacement/doe.csv", "displacement,pressure[kPa]\nfile0.bin,1\n"),
        ("displacement/doe.csv", "q,pressure[kPa],gap[mm]\nfile0.bin,1,40\n"),
    ],
)
def test_inconsistent_exchange_is_refused(exchange, tmp_path, file, content):
    (exchange / file).unlink()
    if content is not None:
        (exchange / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SystemExit):
        main([str(exchange)])
    assert not (tmp_path / "part-database").exists()


# All formats


def test_other_files_are_read_by_meshio(tmp_path):
    data = {"u": displacement(4, 1.0)}
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    meshio.write(tmp_path / "run.vtk", meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]]), ("line", [[0, 1]])], point_data=data))
    run = read(tmp_path / "run.vtk")
    assert counts(run) == {"tetra": 1} and run.left_out == ["cells line"]
    np.testing.assert_allclose(run.states[0][1]["u"], data["u"])
    with pytest.raises(SystemExit):
        main([str(DATA / "write_cdb.py")])


@pytest.mark.parametrize("name", ["series.xdmf", "plain.xplt", "compressed.xplt", "model.cdb"])
def test_damaged_files_are_read_or_refused(tmp_path, name):
    """300 damaged copies: whatever is read has cells and values that fit its nodes."""
    good, rng = (DATA / name).read_bytes(), random.Random(name)
    (tmp_path / "series.h5").write_bytes((DATA / "series.h5").read_bytes())
    for _ in range(300):
        damaged = bytearray(good)
        at = rng.randrange(len(damaged))
        damaged[at : at + rng.randrange(20)] = rng.randbytes(rng.randrange(20))
        (tmp_path / name).write_bytes(damaged)
        try:
            run = read(tmp_path / name)
        except (Refused, OSError, ValueError, KeyError, IndexError, zlib.error):
            continue
        assert all(nodes.max() < len(run.points) for nodes in run.cells.values())
        assert all(len(value) == len(run.points) for _, values in run.states for value in values.values())


def test_values_given_twice_are_refused_unless_equal(tmp_path):
    nodes = (1, 2, 3, 5, 6, 7, 8, 9, 10, 999)
    table = "node,seqv\n" + "".join(f"{node},1.5\n" for node in nodes)
    assert len(read(job(tmp_path, csv=table + "2,1.500000001\n")).states) == 1
    header = "node,seqv,SEQV\n" + "".join(f"{node},1.5,2\n" for node in nodes)
    for text in (table + "2,1.6\n", header):
        with pytest.raises(Refused, match="line|column"):
            read(job(tmp_path, csv=text))
    (tmp_path / "run.inp").write_text(INP)
    (tmp_path / "run.bdf").write_text("BEGIN BULK\nCORD2R,1,,0.,0.,1.,0.,0.,2.\nGRID,1,1,0.,0.,0.\nENDDATA\n")
    for name, match in (("run.inp", "softtwin import"), ("run.bdf", "line 2.*CORD2R")):
        with pytest.raises(Refused, match=match):
            read(tmp_path / name)
