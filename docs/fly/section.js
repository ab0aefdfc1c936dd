// The section through the left tail, drawn on a canvas: x to the right, z up.
// Sites and centres at most this far (m) from the plane are drawn in full.
const NEAR = 0.012;
// Least error (m) with a spot, and the radius of a spot in metres for each metre of error.
const LEAST = 5e-4, SPOT = 0.3;

class SectionPicture {
  constructor(canvas, flight, tail) {
    const { live, cells, beside, faces, start } = flight;
    Object.assign(this, { canvas, flight, tail, pen: canvas.getContext("2d") });
    this.own = new Section(flight, live, cells, live.cells);
    this.beside = new Section(flight, live, beside, [...Array(beside.length / 4).keys()]);
    const xs = live.box.map((corner) => corner[0]), zs = live.box.map((corner) => corner[2]);
    Object.assign(this, { low: [Math.min(...xs), Math.min(...zs)], high: [Math.max(...xs), Math.max(...zs)] });
    this.walls = [];
    const height = (node) => start[3 * node + 1] - flight.meta.section;
    for (let t = 0; t < faces.length; t += 3) {
      const edges = [0, 1, 2].map((k) => [faces[t + k], faces[t + (k + 1) % 3]]).filter(([a, b]) => (height(a) >= 0) !== (height(b) >= 0));
      if (edges.length === 2) this.walls.push(edges.map(([a, b]) => [a, b, height(a) / (height(a) - height(b))]));
    }
  }

  // Draw the mesh with nodes at points, and what a step shows: `lattice`, `jump`, `centres`, `errors`, `parts`.
  draw({ points, before, now, field, angle, shows }) {
    const { canvas, pen, tail, flight: { live } } = this, ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const margin = 0.014, across = this.high[0] - this.low[0] + 2 * margin, up = this.high[1] - this.low[1] + 2 * margin;
    const scale = Math.min(width / across, height / up), values = live.values(angle), move = [0, 0, 0];
    const at = (x, z) => [width / 2 + scale * (x - (this.low[0] + this.high[0]) / 2), height / 2 - scale * (z - (this.low[1] + this.high[1]) / 2)];
    const node = (section, i) => at(section.points[3 * i], section.points[3 * i + 2]);
    const line = (places, colour, wide, dash = []) => {
      pen.beginPath();
      places.forEach((place, i) => (i ? pen.lineTo(...place) : pen.moveTo(...place)));
      Object.assign(pen, { strokeStyle: colour, lineWidth: wide * ratio });
      pen.setLineDash(dash.map((length) => length * ratio));
      pen.stroke();
    };
    const dot = ([x, y], radius, colour) => {
      pen.beginPath();
      pen.arc(x, y, radius, 0, 2 * Math.PI);
      pen.fillStyle = colour;
      pen.fill();
    };
    const pairs = (section, colour, wide) => {
      pen.beginPath();
      for (let i = 0; i < section.lines.length; i += 2) {
        pen.moveTo(...node(section, section.lines[i]));
        pen.lineTo(...node(section, section.lines[i + 1]));
      }
      Object.assign(pen, { strokeStyle: colour, lineWidth: wide * ratio });
      pen.setLineDash([]);
      pen.stroke();
    };
    const word = (text, place, colour, align = "left") => {
      Object.assign(pen, { font: `600 ${13 * ratio}px system-ui, sans-serif`, textAlign: align, lineJoin: "round", lineWidth: 4 * ratio });
      pen.strokeStyle = hue("ground");
      pen.setLineDash([]);
      pen.strokeText(text, ...place);
      pen.fillStyle = colour;
      pen.fillText(text, ...place);
    };

    pen.fillStyle = hue("ground");
    pen.fillRect(0, 0, width, height);
    this.own.follow(points);
    this.beside.follow(points);
    if (shows.parts) this.drawParts(field, shows.parts, angle, scale, at, ratio);
    else {
      const shades = this.own.rows.map((row) => shade(before[row], now[row]));
      for (let level = 0; level <= SHADES; level += 1) {
        pen.beginPath();
        shades.forEach((own, i) => {
          if (own === level) [0, 1, 2].forEach((k) => pen[k ? "lineTo" : "moveTo"](...node(this.own, this.own.triangles[3 * i + k])));
        });
        pen.fillStyle = level === SHADES ? hue("inverted") : css(mixed(hue("ground"), hue("worse"), 0.15 + 0.85 * level / (SHADES - 1)));
        pen.fill();
      }
      pairs(this.beside, hue("cells"), 0.5);
      pairs(this.own, hue("cells"), shows.lattice ? 0.4 : 0.8);
    }
    if (shows.lattice) this.drawLattice(field, values, at, ratio);
    this.walls.forEach((ends) => line(ends.map(([a, b, share]) => at(...[0, 2].map((c) => points[3 * a + c] + share * (points[3 * b + c] - points[3 * a + c])))), hue("moves"), 2.4));

    const held = field.most === tail.count, [x0, z0] = this.low, [x1, z1] = this.high;
    line([at(x0, z0), at(x1, z0), at(x1, z1), at(x0, z1), at(x0, z0)], hue("box"), 1.6, [6, 4]);
    const site = (i) => Array.from(tail.sites.subarray(3 * i, 3 * i + 3)), off = (i) => Math.abs(site(i)[1] - this.flight.meta.section);
    if (held && !shows.parts) {
      for (let i = tail.inMesh; i < tail.count; i += 1) if (off(i) < 0.75 * NEAR) dot(at(site(i)[0], site(i)[2]), 2.2 * ratio, hue("box"));
    }
    if (shows.jump && !held) {
      const steps = 40, rim = [];
      for (let i = 0; i < steps; i += 1) {
        const x = x0 + i / steps * (x1 - x0), z = z0 + i / steps * (z1 - z0);
        rim.push([x, z0], [x1, z], [x0 + x1 - x, z1], [x0, z0 + z1 - z]);
      }
      const found = field.rim = field.rim || field.found.at(Float64Array.from(rim.flatMap(([x, z]) => [x, this.flight.meta.section, z])));
      pen.beginPath();
      rim.forEach(([x, z], i) => {
        displaced(found, tail.columns, values, i, move);
        pen.moveTo(...at(x, z));
        pen.lineTo(...at(x + move[0], z + move[2]));
      });
      Object.assign(pen, { strokeStyle: hue("worse"), lineWidth: 1.5 * ratio });
      pen.setLineDash([]);
      pen.stroke();
    }
    if (shows.inverted) this.drawInverted(points, now, at, line);
    if (shows.errors) {
      const errors = tail.errors(field, angle);
      errors.forEach((error, i) => {
        if (error < LEAST || off(i) > NEAR) return;
        pen.globalAlpha = 0.2;
        dot(at(site(i)[0], site(i)[2]), SPOT * error * scale, hue("worse"));
        pen.globalAlpha = 0.9;
        Object.assign(pen, { strokeStyle: hue("worse"), lineWidth: ratio });
        pen.setLineDash([]);
        pen.stroke();
      });
    }
    for (const i of shows.centres ? field.centres || [] : []) {
      pen.globalAlpha = off(i) < NEAR ? 1 : 0.45;
      dot(at(site(i)[0], site(i)[2]), (off(i) < NEAR ? 4.5 : 3.2) * ratio, hue("ink"));
    }
    pen.globalAlpha = 1;
    word("the box", [at(x0, z1)[0] + 8 * ratio, at(x0, z1)[1] + 18 * ratio], hue("soft"));
  }

  drawLattice(field, values, at, ratio) {
    const { pen } = this, { rows } = this.tail.lattice, move = [0, 0, 0];
    const moved = rows.map((row) => row.map(([x, z, i]) => {
      if (i < 0) return at(x, z);
      displaced(field.lattice, this.tail.columns, values, i, move);
      return at(x + move[0], z + move[2]);
    }));
    const joined = ([j, i], [m, n]) => {
      if ((rows[j][i][2] < 0) !== (rows[m][n][2] < 0)) return; // the lines are cut at the box
      pen.moveTo(...moved[j][i]);
      pen.lineTo(...moved[m][n]);
    };
    pen.beginPath();
    rows.forEach((row, j) => row.forEach((_, i) => {
      if (i) joined([j, i - 1], [j, i]);
      if (j) joined([j - 1, i], [j, i]);
    }));
    Object.assign(pen, { strokeStyle: hue("ink"), lineWidth: 0.7 * ratio, globalAlpha: 0.45 });
    pen.setLineDash([]);
    pen.stroke();
    pen.globalAlpha = 1;
  }

  // All edges of the cells that are inside out, also of those beside the section.
  drawInverted(points, now, at, line) {
    const { cells, live } = this.flight, EDGES = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    for (const row of live.cells) {
      if (now[row] >= 0) continue;
      for (const pair of EDGES) line(pair.map((k) => 3 * cells[4 * row + k]).map((i) => at(points[i], points[i + 2])), hue("inverted"), 1.2);
    }
  }

  // How far the first `count` parts of the sum would move each place: the functions one by one, then the linear part.
  drawParts(field, count, angle, scale, at, ratio) {
    const { pen, tail, low, high, flight: { live, meta } } = this, nx = 96, nz = Math.round(nx * (high[1] - low[1]) / (high[0] - low[0]));
    const most = Math.min(count, field.centres.length);
    if (!field.parts || field.parts.count !== count) {
      const places = new Float64Array(3 * nx * nz);
      for (let j = 0; j < nz; j += 1) {
        for (let i = 0; i < nx; i += 1) places.set([low[0] + (i + 0.5) / nx * (high[0] - low[0]), meta.section, high[1] - (j + 0.5) / nz * (high[1] - low[1])], 3 * (j * nx + i));
      }
      field.parts = { count, values: field.found.at(places, most, count > most) };
    }
    const found = field.parts.values, now = live.values(angle), move = [0, 0, 0];
    const sizes = Float64Array.from({ length: nx * nz }, (_, i) => Math.hypot(...displaced(found, tail.columns, now, i, move)));
    const top = Math.max(...sizes, 1e-9), picture = new ImageData(nx, nz), BANDS = 10;
    const bands = Array.from({ length: BANDS }, (_, i) => mixed(hue("ground"), hue("moves"), 0.05 + 0.75 * i / (BANDS - 1)));
    sizes.forEach((size, i) => picture.data.set([...bands[Math.min(BANDS - 1, Math.floor(BANDS * size / top))], 255], 4 * i));
    const small = Object.assign(document.createElement("canvas"), { width: nx, height: nz });
    small.getContext("2d").putImageData(picture, 0, 0);
    pen.imageSmoothingEnabled = true;
    pen.drawImage(small, ...at(low[0], high[1]), scale * (high[0] - low[0]), scale * (high[1] - low[1]));
    this.top = top;
  }
}
