// A model's visible surface: facets over nodes, split into drawable vertices where the surface has an edge.

const POINT_ANGLE = 0.002; // rad: about four pixels
const CREASE_COS = Math.cos((40 * Math.PI) / 180);

export class Mesh {
  // `undeformed`: 3 coordinates per node, `facets`: 3 nodes per facet, `ids`: the nodes' numbers in the model.
  constructor(undeformed, facets, ids) {
    Object.assign(this, { undeformed, facets, ids, nodes: ids.length, version: 0 });
    this.split();
    this.positions = new Float32Array(3 * this.source.length);
    this.normals = new Float32Array(3 * this.source.length);
    this.values = new Float32Array(this.source.length);
  }

  // The same surface with separate vertices, for one more actuator of the same model.
  copy() {
    const copy = Object.assign(Object.create(Mesh.prototype), this, { version: 0 });
    for (const name of ["positions", "normals", "values"]) copy[name] = this[name].slice();
    copy.cavities = this.cavities?.map((cavity) => ({ ...cavity, walls: cavity.walls.copy() }));
    return copy;
  }

  // Gives each corner the vertex of its node that belongs to its side of an edge. Done once, on the undeformed shape.
  split() {
    const { facets, undeformed, nodes } = this;
    const count = facets.length / 3;
    const normals = new Float32Array(3 * count);
    for (let f = 0; f < count; f++) unit(areaNormal(undeformed, facets, f, normals));
    const groups = Array.from({ length: nodes }, () => []); // per node: [normal sum, vertex]
    this.source = [];
    this.corners = new Uint32Array(facets.length);
    for (let corner = 0; corner < facets.length; corner++) {
      const [node, f] = [facets[corner], 3 * Math.floor(corner / 3)];
      const n = [normals[f], normals[f + 1], normals[f + 2]];
      let group = groups[node].find((g) => dot(g.normal, n) > CREASE_COS * Math.hypot(...g.normal));
      if (!group) {
        group = { normal: [0, 0, 0], vertex: this.source.length };
        groups[node].push(group);
        this.source.push(node);
      }
      for (let k = 0; k < 3; k++) group.normal[k] += n[k];
      this.corners[corner] = group.vertex;
    }
    this.edges = edgesOf(this.corners);
    this.outward = outwardOf(facets, undeformed);
  }

  // Moves the vertices to a frame's coordinates (field-major: all x, then y, then z) and makes smooth normals.
  deform(x, y, z, values) {
    const { source, positions, normals, corners } = this;
    this.version++;
    for (let v = 0; v < source.length; v++) {
      const node = source[v];
      positions[3 * v] = x[node]; positions[3 * v + 1] = y[node]; positions[3 * v + 2] = z[node];
      this.values[v] = values[node];
    }
    normals.fill(0);
    const n = { 0: 0, 1: 0, 2: 0 };
    for (let f = 0; f < corners.length; f += 3) {
      crossInto(positions, corners[f], corners[f + 1], corners[f + 2], n);
      for (let k = 0; k < 3; k++) {
        const at = 3 * corners[f + k];
        normals[at] += n[0]; normals[at + 1] += n[1]; normals[at + 2] += n[2];
      }
    }
  }
}

function crossInto(p, a, b, c, out) {
  const [i, j, k] = [3 * a, 3 * b, 3 * c];
  const ux = p[j] - p[i], uy = p[j + 1] - p[i + 1], uz = p[j + 2] - p[i + 2];
  const vx = p[k] - p[i], vy = p[k + 1] - p[i + 1], vz = p[k + 2] - p[i + 2];
  out[0] = uy * vz - uz * vy; out[1] = uz * vx - ux * vz; out[2] = ux * vy - uy * vx;
}

function areaNormal(p, facets, f, normals) {
  const out = normals.subarray(3 * f, 3 * f + 3);
  crossInto(p, facets[3 * f], facets[3 * f + 1], facets[3 * f + 2], out);
  return out;
}

function unit(v) {
  const length = Math.hypot(v[0], v[1], v[2]) || 1;
  for (let k = 0; k < 3; k++) v[k] /= length;
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// Each edge once, as pairs of vertices.
function edgesOf(corners) {
  const seen = new Set();
  const edges = [];
  for (let f = 0; f < corners.length; f += 3) {
    for (let k = 0; k < 3; k++) {
      const [a, b] = [corners[f + k], corners[f + ((k + 1) % 3)]];
      const key = Math.min(a, b) * 2 ** 26 + Math.max(a, b);
      if (!seen.has(key)) { seen.add(key); edges.push(a, b); }
    }
  }
  return new Uint32Array(edges);
}

// 1 if the facets turn around the outward normals of a closed surface, -1 around the inward ones, 0 if the surface has a border.
function outwardOf(facets, undeformed) {
  const open = new Set();
  let volume = 0;
  for (let f = 0; f < facets.length; f += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => facets[f + k]);
    for (const [from, to] of [[a, b], [b, c], [c, a]]) {
      if (!open.delete(to * 2 ** 26 + from)) open.add(from * 2 ** 26 + to);
    }
    const [p, q, r] = [a, b, c].map((node) => undeformed.subarray(3 * node, 3 * node + 3));
    volume += p[0] * (q[1] * r[2] - q[2] * r[1]) + p[1] * (q[2] * r[0] - q[0] * r[2]) + p[2] * (q[0] * r[1] - q[1] * r[0]);
  }
  return open.size ? 0 : Math.sign(volume);
}

// Nodes without a known surface: drawn as points.
export class Points {
  constructor(nodes) {
    Object.assign(this, { nodes, version: 0, ids: Uint32Array.from({ length: nodes }, (_, k) => k) });
    this.positions = new Float32Array(3 * nodes);
    this.normals = new Float32Array(3 * nodes);
    this.values = new Float32Array(nodes);
  }

  deform(x, y, z, values) {
    this.version++;
    for (let v = 0; v < this.nodes; v++) this.positions.set([x[v], y[v], z[v]], 3 * v);
    this.values.set(values);
  }
}

// The node nearest to where a ray first meets the surface, or -1. The body has a position in the scene, so the ray is
// transformed into the body's frame; distances are unchanged.
export function pick(mesh, sceneOrigin, sceneDirection, { offset, flip }) {
  const origin = sceneOrigin.map((v, k) => (v - offset[k]) * (k === 1 ? flip : 1));
  const direction = sceneDirection.map((v, k) => v * (k === 1 ? flip : 1));
  const p = mesh.positions;
  if (!mesh.corners) return nearestPoint(mesh, origin, direction);
  let [best, bestT] = [-1, Infinity];
  for (let f = 0; f < mesh.corners.length; f += 3) {
    const hit = meet(p, mesh.corners, f, origin, direction);
    if (hit && hit.t < bestT) {
      bestT = hit.t;
      const weights = [1 - hit.u - hit.v, hit.u, hit.v];
      best = mesh.source[mesh.corners[f + weights.indexOf(Math.max(...weights))]];
    }
  }
  return { node: best, distance: bestT };
}

// Of points without a surface: the first one within a small angle of the ray.
function nearestPoint({ positions: p, nodes }, origin, direction) {
  const length = Math.hypot(...direction);
  let [node, distance] = [-1, Infinity];
  for (let k = 0; k < nodes; k++) {
    const to = [p[3 * k] - origin[0], p[3 * k + 1] - origin[1], p[3 * k + 2] - origin[2]];
    const along = dot(to, direction) / length;
    const aside = Math.sqrt(Math.max(0, dot(to, to) - along * along));
    if (along > 0 && along < distance && aside < POINT_ANGLE * along) [node, distance] = [k, along];
  }
  return { node, distance: distance / length };
}

// Where a ray meets one triangle: distance and weights of the second and third corner.
function meet(p, corners, f, origin, direction) {
  const [i, j, k] = [3 * corners[f], 3 * corners[f + 1], 3 * corners[f + 2]];
  const e1 = [p[j] - p[i], p[j + 1] - p[i + 1], p[j + 2] - p[i + 2]];
  const e2 = [p[k] - p[i], p[k + 1] - p[i + 1], p[k + 2] - p[i + 2]];
  const h = [direction[1] * e2[2] - direction[2] * e2[1], direction[2] * e2[0] - direction[0] * e2[2], direction[0] * e2[1] - direction[1] * e2[0]];
  const a = dot(e1, h);
  if (Math.abs(a) < 1e-12) return null;
  const s = [origin[0] - p[i], origin[1] - p[i + 1], origin[2] - p[i + 2]];
  const u = dot(s, h) / a;
  if (u < 0 || u > 1) return null;
  const q = [s[1] * e1[2] - s[2] * e1[1], s[2] * e1[0] - s[0] * e1[2], s[0] * e1[1] - s[1] * e1[0]];
  const v = dot(direction, q) / a;
  const t = dot(e2, q) / a;
  return v >= 0 && u + v <= 1 && t > 0 ? { t, u, v } : null;
}
