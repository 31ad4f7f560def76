"""Second-order tetrahedra in numpy: a second implementation of what `crates/fem` and CalculiX' C3D10 do, with one switch between them.

Energy per volume: W(I) + K/2 (J - 1)^2, Yeoh's W. The volumetric part is taken of the mean of J over the element (`mean`, one pressure an
element, as `crates/fem`) or of J at each Gauss point (`points`, as CalculiX). Gravity, pressure that follows the faces, a flat plate below.
"""
import itertools

import numpy
import scipy.sparse
import scipy.sparse.linalg

EDGES = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
FACES = [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]]  # P1 to P4 of CalculiX
# Points (r, s, weight) on a face: CalculiX uses three, crates/fem six.
A, B, WA, WB = 0.445948490915965, 0.091576213509771, 0.223381589678011, 0.109951743655322
FACE_POINTS = {
    3: [(1 / 6, 1 / 6, 1 / 3), (2 / 3, 1 / 6, 1 / 3), (1 / 6, 2 / 3, 1 / 3)],
    6: [(A, A, WA), (1 - 2 * A, A, WA), (A, 1 - 2 * A, WA), (B, B, WB), (1 - 2 * B, B, WB), (B, 1 - 2 * B, WB)],
}
CROSS = numpy.zeros((3, 3, 3))
for i, j, k in itertools.permutations(range(3)):
    CROSS[i, j, k] = (i - j) * (j - k) * (k - i) / 2


def tetrahedron():
    """Shape functions and their derivatives at the four Gauss points."""
    slopes = numpy.array([[-1.0, -1.0, -1.0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    values, derivatives = [], []
    for q in range(4):
        at = numpy.full(4, 0.1381966011250105)
        at[q] = 0.5854101966249685
        values.append(numpy.r_[at * (2 * at - 1), [4 * at[i] * at[j] for i, j in EDGES]])
        middles = [4 * (at[j] * slopes[i] + at[i] * slopes[j]) for i, j in EDGES]
        derivatives.append(numpy.vstack([(4 * at - 1)[:, None] * slopes, middles]))
    return numpy.array(values), numpy.array(derivatives)


def triangle(r, s):
    t = 1 - r - s
    values = numpy.array([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    by_r = numpy.array([1 - 4 * t, 4 * r - 1, 0, 4 * (t - r), 4 * s, -4 * s])
    by_s = numpy.array([1 - 4 * t, 0, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)])
    return values, by_r, by_s


def penalty(depth, width):
    """Force and stiffness of a linear penalty, rounded by a parabola over -width to width."""
    inside = numpy.clip(depth + width, 0, 2 * width)
    return numpy.where(depth < width, inside**2 / (4 * width), depth), inside / (2 * width)


class Body:
    """`cavity` and `bottom` are lists of (element, face); lengths in mm, stresses in MPa, masses in t."""

    def __init__(self, points, tets, fixed, cavity, bottom, law, bulk, density, volumetric, face_points, plate):
        self.points, self.tets, self.law, self.bulk, self.mean = points, tets, law, bulk, volumetric == "mean"
        self.cavity = numpy.array([tets[e][FACES[f]] for e, f in cavity])
        self.face_points = FACE_POINTS[face_points]
        values, derivatives = tetrahedron()
        jacobian = numpy.einsum("eai,qaj->eqij", points[tets], derivatives)
        self.weights = numpy.linalg.det(jacobian) / 24
        self.gradients = numpy.einsum("qaj,eqji->eqai", derivatives, numpy.linalg.inv(jacobian))
        self.mass = numpy.zeros(len(points))
        numpy.add.at(self.mass, tets, density * numpy.einsum("eq,qa->ea", self.weights, values))
        self.area = numpy.zeros(len(points))
        for e, f in bottom:
            nodes = tets[e][FACES[f]]
            a, b, c = points[nodes[:3]]
            area = numpy.linalg.norm(numpy.cross(b - a, c - a)) / 2
            self.area[nodes] += area * numpy.array([1, 1, 1, 3, 3, 3]) / 12
        self.stiffness, self.rounding = plate
        self.free = numpy.setdiff1d(numpy.arange(3 * len(points)), (3 * fixed[:, None] + numpy.arange(3)).ravel())

    def touching(self, u, gap):
        if gap is None:
            return numpy.zeros(len(u)), numpy.zeros(len(u))
        force, stiffness = penalty(-gap - self.points[:, 1] - u[:, 1], self.rounding)
        return self.stiffness * self.area * force, self.stiffness * self.area * stiffness

    def solids(self, u):
        """Nodal forces and stiffness matrices of the elements."""
        one, c, weights = numpy.eye(3), self.law, self.weights
        f = one + numpy.einsum("eai,eqaj->eqij", u[self.tets], self.gradients)
        det, inverse = numpy.linalg.det(f), numpy.linalg.inv(f).swapaxes(2, 3)
        trace, iso = numpy.einsum("eqij,eqij->eq", f, f), det ** (-2 / 3)
        e = iso * trace - 3
        first, second = c[0] + 2 * c[1] * e + 3 * c[2] * e * e, 2 * c[1] + 6 * c[2] * e
        volume = weights.sum(1)
        change = (weights * (det - 1)).sum(1) / volume
        pressure = self.bulk * (numpy.repeat(change[:, None], 4, 1) if self.mean else det - 1)
        wide = lambda scalar, rank: scalar.reshape(scalar.shape + (1,) * rank)
        pair = lambda a, b: numpy.einsum("eqij,eqkl->eqijkl", a, b)
        s = 2 * first * iso
        shape = f - wide(trace / 3, 2) * inverse
        stress = wide(s, 2) * shape + wide(pressure * det, 2) * inverse
        force = numpy.einsum("eqij,eqaj,eq->eai", stress, self.gradients, weights)
        change_of_s = wide(4 * second * iso * iso, 2) * shape - wide(4 / 3 * first * iso, 2) * inverse
        moduli = wide(s, 4) * numpy.einsum("ik,jl->ijkl", one, one) + pair(shape, change_of_s)
        moduli += wide(pressure * det, 4) * pair(inverse, inverse) - wide(2 / 3 * s, 4) * pair(inverse, f)
        moduli += wide(s * trace / 3 - pressure * det, 4) * numpy.einsum("eqil,eqkj->eqijkl", inverse, inverse)
        if not self.mean:
            moduli += wide(self.bulk * det**2, 4) * pair(inverse, inverse)
        terms = (self.gradients, moduli, self.gradients, weights)
        count = len(self.tets)
        matrix = numpy.einsum("eqaj,eqijkl,eqbl,eq->eaibk", *terms, optimize=True).reshape(count, 30, 30)
        if self.mean:
            b = numpy.einsum("eq,eqij,eqaj->eai", weights * det, inverse, self.gradients).reshape(count, 30)
            matrix += (self.bulk / volume)[:, None, None] * b[:, :, None] * b[:, None, :]
        return force, matrix

    def system(self, u, gravity, pressure, gap):
        """Forces out of balance and tangent."""
        force, matrix = self.solids(u)
        out = numpy.zeros_like(u)
        numpy.add.at(out, self.tets, -force)
        out[:, 1] -= gravity * self.mass
        blocks = [(self.tets, matrix)]
        if pressure:
            x = (self.points + u)[self.cavity]
            matrix = numpy.zeros((len(x), 6, 3, 6, 3))
            for r, s, weight in self.face_points:
                n, by_r, by_s = triangle(r, s)
                along_r, along_s = numpy.einsum("a,eai->ei", by_r, x), numpy.einsum("a,eai->ei", by_s, x)
                load = 0.5 * weight * pressure
                numpy.add.at(out, self.cavity, -load * numpy.einsum("a,ei->eai", n, numpy.cross(along_r, along_s)))
                turn = numpy.einsum("ijk,b,ek->eibj", CROSS, by_r, along_s)
                turn += numpy.einsum("ikj,ek,b->eibj", CROSS, along_r, by_s)
                matrix += load * numpy.einsum("a,eibj->eaibj", n, turn)
            blocks.append((self.cavity, matrix.reshape(len(x), 18, 18)))
        push, stiffness = self.touching(u, gap)
        out[:, 1] += push
        rows, columns, values = [3 * numpy.arange(len(u)) + 1], [3 * numpy.arange(len(u)) + 1], [stiffness]
        for nodes, matrix in blocks:
            unknowns = (3 * nodes[:, :, None] + numpy.arange(3)).reshape(len(nodes), -1)
            count = unknowns.shape[1]
            rows.append(numpy.repeat(unknowns, count, 1).ravel())
            columns.append(numpy.tile(unknowns, (1, count)).ravel())
            values.append(matrix.ravel())
        entries = (numpy.concatenate(values), (numpy.concatenate(rows), numpy.concatenate(columns)))
        return out.ravel(), scipy.sparse.csc_matrix(entries, shape=(u.size, u.size))

    def solve(self, start, gravity, pressure, gap):
        """Displacements (mm) and force on the plate (N) of the equilibrium next to `start`, which is what another program found: it comes
        at once where that program is right, and no path through the contact has to be followed."""
        u = start.copy()
        self.newton(u, gravity, pressure, gap)
        return u, self.touching(u, gap)[0].sum()

    def newton(self, u, gravity, pressure, gap):
        for _ in range(30):
            out, tangent = self.system(u, gravity, pressure, gap)
            step = scipy.sparse.linalg.spsolve(tangent[self.free][:, self.free], out[self.free], "MMD_AT_PLUS_A")
            u.ravel()[self.free] += step
            if numpy.abs(step).max() < 1e-9:
                return
        raise AssertionError(f"no equilibrium: last correction {numpy.abs(step).max():.1e} mm")
