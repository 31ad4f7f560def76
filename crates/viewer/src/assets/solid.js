// Rigid things of a scene: blocks, the plate's slab, arrows. They have no values, so they are drawn in a plain colour.

const ROUND = 24; // corners of a circle

// A box with flat faces.
export function block([x0, y0, z0], [x1, y1, z1]) {
  const faces = [
    [[x0, y0, z0], [x0, y0, z1], [x0, y1, z1], [x0, y1, z0], [-1, 0, 0]], [[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1], [1, 0, 0]],
    [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1], [0, -1, 0]], [[x0, y1, z0], [x0, y1, z1], [x1, y1, z1], [x1, y1, z0], [0, 1, 0]],
    [[x0, y0, z0], [x0, y1, z0], [x1, y1, z0], [x1, y0, z0], [0, 0, -1]], [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1], [0, 0, 1]],
  ];
  const corners = faces.flatMap((_, f) => [0, 1, 2, 0, 2, 3].map((k) => 4 * f + k));
  return solid(faces.flatMap((face) => face.slice(0, 4).flat()), faces.flatMap((face) => [0, 1, 2, 3].flatMap(() => face[4])), corners);
}

function solid(positions, normals, corners) {
  return {
    version: 0,
    positions: Float32Array.from(positions),
    normals: Float32Array.from(normals),
    values: new Float32Array(positions.length / 3).fill(NaN),
    corners: Uint32Array.from(corners),
    edges: new Uint32Array(0),
  };
}

// Shaft and head of an arrow along -y from the origin: each one unit wide and long, to be scaled.
export const SHAFT = turned([[0, 0], [1, 0], [1, -1], [0, -1]]);
export const HEAD = turned([[0, 0], [1, 0], [0, -1]]);

// A body of revolution about y, from the (radius, height) corners of its outline.
function turned(outline) {
  const [positions, normals] = [[], []];
  for (let k = 0; k < ROUND; k++) {
    const [a, b] = [k, k + 1].map((i) => (2 * Math.PI * i) / ROUND);
    for (let i = 0; i + 1 < outline.length; i++) {
      const [[r0, y0], [r1, y1]] = [outline[i], outline[i + 1]];
      const point = (r, angle, y) => [r * Math.cos(angle), y, r * Math.sin(angle)];
      const normal = (angle) => [(y0 - y1) * Math.cos(angle), r1 - r0, (y0 - y1) * Math.sin(angle)];
      for (const [r, angle, y] of [[r0, a, y0], [r1, a, y1], [r1, b, y1], [r0, a, y0], [r1, b, y1], [r0, b, y0]]) {
        positions.push(...point(r, angle, y));
        normals.push(...normal(angle));
      }
    }
  }
  return solid(positions, normals, Array.from({ length: positions.length / 3 }, (_, k) => k));
}
