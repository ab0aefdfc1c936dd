"use strict";
// The quality of cells by their type, as meshing/mesh/compiled_quality.py measures it; -1 counts nodes left-handed.
const measured = (() => {
  const CORNERS = {
    quad: [[0, 1, 3], [1, 2, 0], [2, 3, 1], [3, 0, 2]],
    wedge: [[0, 2, 1, 3], [1, 0, 2, 4], [2, 1, 0, 5], [3, 4, 5, 0], [4, 5, 3, 1], [5, 3, 4, 2]],
    hexahedron: [[0, 1, 3, 4], [1, 2, 0, 5], [2, 3, 1, 6], [3, 0, 2, 7], [4, 7, 5, 0], [5, 4, 6, 1], [6, 5, 7, 2], [7, 6, 4, 3]],
    pyramid: [[0, 1, 2, 4], [0, 2, 3, 4], [0, 1, 3, 4], [1, 2, 3, 4]],
  };
  const AXES = [[[0, 3, 7, 4], [1, 2, 6, 5]], [[0, 1, 5, 4], [3, 2, 6, 7]], [[0, 1, 2, 3], [4, 5, 6, 7]]];
  const TINY = 2 ** -1022, [a, b, c] = [new Float64Array(3), new Float64Array(3), new Float64Array(3)];
  let points, faces; // coordinates, and nodes of cells

  function edge(out, first, from, to) {
    const o = 3 * faces[first + from], e = 3 * faces[first + to];
    for (let i = 0; i < 3; i += 1) out[i] = points[e + i] - points[o + i];
  }
  const square = (v) => v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
  const determinant = () => a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
  function between(first, one, other) {
    const o = 3 * faces[first + one], e = 3 * faces[first + other];
    return (points[e] - points[o]) ** 2 + (points[e + 1] - points[o + 1]) ** 2 + (points[e + 2] - points[o + 2]) ** 2;
  }
  // Edges from the first corner of four to the others.
  function corner(first, [o, p, q, r]) {
    edge(a, first, o, p);
    edge(b, first, o, q);
    edge(c, first, o, r);
  }

  function triangle(first, sign) {
    edge(a, first, 0, 1);
    edge(b, first, 0, 2);
    const area = sign * (a[0] * b[1] - a[1] * b[0]), sum = square(a) + between(first, 1, 2) + square(b);
    return 2 * Math.sqrt(3) * Math.max(area, 0) / Math.max(sum, TINY);
  }
  function quad(first, sign) {
    let least = Infinity;
    for (const [o, p, q] of CORNERS.quad) {
      edge(a, first, o, p);
      edge(b, first, o, q);
      least = Math.min(least, sign * (a[0] * b[1] - a[1] * b[0]) / Math.sqrt(Math.max(square(a) * square(b), TINY)));
    }
    return least;
  }
  function tetra(first, sign) {
    corner(first, [0, 1, 2, 3]);
    const sum = square(a) + square(b) + square(c) + between(first, 1, 2) + between(first, 1, 3) + between(first, 2, 3);
    return 12 * Math.cbrt(0.25 * Math.max(sign * determinant(), 0) ** 2) / Math.max(sum, TINY);
  }
  function pyramid(first, sign) {
    let least = Infinity;
    for (const four of CORNERS.pyramid) {
      corner(first, four);
      const [, p, q, r] = four, [oa, ob, oc] = [square(a), square(b), square(c)];
      const [ab, ac, bc] = [between(first, p, q), between(first, p, r), between(first, q, r)];
      const largest = Math.max(oa * ob * oc, oa * ab * ac, ob * ab * bc, oc * ac * bc, TINY);
      least = Math.min(least, 2 * sign * determinant() / Math.sqrt(largest));
    }
    return Math.max(least > 1 ? 2 - least : least, 0);
  }
  const share = (sign) => sign * determinant() / Math.sqrt(Math.max(square(a) * square(b) * square(c), TINY));
  function wedge(first, sign) {
    let least = Infinity;
    for (const four of CORNERS.wedge) {
      corner(first, four);
      least = Math.min(least, share(sign));
    }
    return 2 / Math.sqrt(3) * least;
  }
  function hexahedron(first, sign) {
    let least = Infinity;
    for (const four of CORNERS.hexahedron) {
      corner(first, four);
      least = Math.min(least, share(sign));
    }
    [a, b, c].forEach((way, k) => {
      for (let i = 0; i < 3; i += 1) {
        const sum = (four) => four.reduce((total, node) => total + points[3 * faces[first + node] + i], 0);
        way[i] = sum(AXES[k][1]) - sum(AXES[k][0]);
      }
    });
    return Math.min(least, share(sign));
  }
  const OF_SHAPE = { triangle, quad, tetra, pyramid, wedge, hexahedron };

  // Write the quality of cells of one shape, k nodes each, into `out`.
  return (shape, coordinates, nodes, k, sign, out) => {
    [points, faces] = [coordinates, nodes];
    const measure = OF_SHAPE[shape];
    for (let cell = 0; cell < out.length; cell += 1) out[cell] = measure(k * cell, sign);
    return out;
  };
})();
