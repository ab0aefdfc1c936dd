// The fighter in its mesh: what is in the data of the page, how the plan's fields move it, and the quality of its cells.
const inflated = async (name) => {
  const packed = Uint8Array.from(atob(document.getElementById(name).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")));
};
// Functions of an amount (degrees) by which fields are multiplied; as in `deform/surface/motions.py`.
const FUNCTIONS = {
  Turn: ({ count }) => (amount) => Array.from({ length: count }, (_, i) => {
    const angle = Math.PI / 180 * amount * (1 + (i >> 1));
    return i % 2 ? 2 * Math.sin(angle / 2) ** 2 : Math.sin(angle);
  }),
  Powers: ({ count, scale }) => (amount) => Array.from({ length: count }, (_, i) => (amount / scale) ** (i + 1)),
};

async function unpacked(name) {
  const bytes = new Uint8Array(await (await inflated(name)).arrayBuffer()), first = bytes.indexOf(10) + 1;
  const meta = JSON.parse(new TextDecoder().decode(bytes.subarray(0, first)));
  const KINDS = { f4: Float32Array, u2: Uint16Array, i2: Int16Array };
  const array = (key) => {
    const [start, count, kind] = meta.arrays[key], size = Number(kind[1]), out = new Uint8Array(count * size);
    for (let k = 0; k < size; k += 1) for (let i = 0; i < count; i += 1) out[i * size + k] = bytes[first + start + k * count + i];
    return new KINDS[kind](out.buffer);
  };
  // Arrays are kept column by column; here rows (M, width) are wanted, in the quantum of each column.
  const rows = (key, width, quanta) => {
    const found = array(key), count = found.length / width, out = new Float64Array(found.length);
    found.forEach((value, i) => { out[width * (i % count) + Math.floor(i / count)] = quanta ? value * quanta[Math.floor(i / count)] : value; });
    return out;
  };
  // Nodes of cells: the step from the first node of the cell before, then what the others are beyond the first.
  const nodes = (key, width) => {
    const out = Uint16Array.from(rows(key, width));
    for (let i = 0; i < out.length; i += width) {
      out[i] += i ? out[i - width] : 0;
      for (let k = 1; k < width; k += 1) out[i + k] += out[i];
    }
    return out;
  };
  const start = rows("points", 3), cells = nodes("cells", 4);
  const surfaces = meta.surfaces.map((one, k) => {
    const columns = one.quanta.length;
    let row = 0;
    return { ...one, columns, rows: array(`rows${k}`).map((step) => { row += step; return row; }),
      fields: rows(`fields${k}`, columns, one.quanta), values: FUNCTIONS[one.functions.kind](one.functions) };
  });
  for (const one of surfaces) {
    const moves = new Uint8Array(start.length / 3);
    one.rows.forEach((row) => { moves[row] = 1; });
    one.cells = Uint32Array.from(Array(cells.length / 4).keys()).filter((i) => [0, 1, 2, 3].some((k) => moves[cells[4 * i + k]]));
  }
  let face = 0;
  const patches = meta.patches.map((one) => { face += one.faces; return { ...one, first: face - one.faces }; });
  const live = surfaces[meta.live], { lattice } = meta;
  return {
    meta, start, cells, surfaces, patches, live, faces: nodes("faces", 3), beside: nodes("beside", 4),
    free: array("free"), moving: array("moving"), held: array("held"), zero: rows("zero", 3),
    whole: rows("whole", live.columns, meta.free), lattice: { ...lattice, whole: rows("lattice", live.columns, lattice.quanta) },
  };
}

// Add the displacement by fields (M, columns): the sum of the functions' values times the vectors of each row.
function displaced(fields, columns, values, i, out) {
  let [x, y, z] = [0, 0, 0];
  for (let k = 0, j = i * columns; k < values.length; k += 1, j += 3) {
    x += values[k] * fields[j];
    y += values[k] * fields[j + 1];
    z += values[k] * fields[j + 2];
  }
  out[0] = x;
  out[1] = y;
  out[2] = z;
  return out;
}

// Write the coordinates of all nodes with the surfaces at amounts, as the plan gives them.
function place(flight, amounts, out) {
  const move = [0, 0, 0];
  out.set(flight.start);
  flight.surfaces.forEach(({ rows, fields, columns, values }, k) => {
    if (!amounts[k]) return;
    const now = values(amounts[k]);
    for (let i = 0; i < rows.length; i += 1) {
      displaced(fields, columns, now, i, move);
      for (let c = 0; c < 3; c += 1) out[3 * rows[i] + c] += move[c];
    }
  });
}

// Write the mean ratio of cells (rows of `chosen`): 1 for the regular tetrahedron, -1 for one that is inside out.
function judge(points, cells, chosen, out) {
  for (let i = 0; i < chosen.length; i += 1) {
    const t = 4 * chosen[i], a = 3 * cells[t], b = 3 * cells[t + 1], c = 3 * cells[t + 2], d = 3 * cells[t + 3];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const wx = points[d] - points[a], wy = points[d + 1] - points[a + 1], wz = points[d + 2] - points[a + 2];
    const volume = ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx);
    const px = ux - vx, py = uy - vy, pz = uz - vz, qx = ux - wx, qy = uy - wy, qz = uz - wz, rx = vx - wx, ry = vy - wy, rz = vz - wz;
    const edges = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
      + px * px + py * py + pz * pz + qx * qx + qy * qy + qz * qz + rx * rx + ry * ry + rz * rz;
    out[chosen[i]] = volume > 0 ? 12 * Math.cbrt(0.25 * volume * volume) / edges : -1;
  }
}

// The cut of cells by a plane: corners on edges that the plane cuts, which go with the nodes of these edges.
class Section {
  constructor(flight, { normal, offset }, cells, chosen) {
    const { start } = flight, seen = new Map(), ends = [], shares = [], triangles = [], rows = [], lines = new Map();
    const height = (node) => normal.reduce((sum, value, c) => sum + value * start[3 * node + c], -offset);
    const corner = (a, b) => {
      const [low, high] = a < b ? [a, b] : [b, a], key = low * 65_536 + high;
      if (!seen.has(key)) {
        seen.set(key, shares.length);
        ends.push(low, high);
        shares.push(height(low) / (height(low) - height(high)));
      }
      return seen.get(key);
    };
    for (const row of chosen) {
      const nodes = Array.from(cells.subarray(4 * row, 4 * row + 4)), up = nodes.filter((node) => height(node) >= 0);
      const down = nodes.filter((node) => !up.includes(node));
      if (!up.length || !down.length) continue;
      const ring = up.flatMap((a, i) => (i ? down.slice().reverse() : down).map((b) => corner(a, b)));
      for (let i = 2; i < ring.length; i += 1) { triangles.push(ring[0], ring[i - 1], ring[i]); rows.push(row); }
      ring.forEach((a, i) => {
        const b = ring[(i + 1) % ring.length];
        lines.set(Math.min(a, b) * 65_536 + Math.max(a, b), [a, b]);
      });
    }
    Object.assign(this, { ends, shares, triangles, rows, lines: [...lines.values()].flat(), points: new Float32Array(3 * shares.length) });
  }

  follow(points) {
    this.shares.forEach((share, i) => {
      const a = 3 * this.ends[2 * i], b = 3 * this.ends[2 * i + 1];
      for (let c = 0; c < 3; c += 1) this.points[3 * i + c] = points[a + c] + share * (points[b + c] - points[a + c]);
    });
  }
}
