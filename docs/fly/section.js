// The section through the left tail, drawn on a canvas: x to the right, z up.
// Sites and centres at most this far (m) from the plane are drawn in full; the view ends this far (m) beyond the box.
const NEAR = 0.012, VIEW_BESIDE = 0.014;
// Least error (m) with a spot, and the radius of a spot in metres for each metre of error.
const LEAST = 5e-4, SPOT = 0.3;
// Points on each side of the box at which a jump is drawn; columns and shades of the picture of a sum.
const RIM = 40, COLUMNS = 96, BANDS = 10;

// A canvas on which places are metres and widths are pixels.
class Plot {
  constructor(canvas, low, high) {
    Object.assign(this, { canvas, low, high, pen: canvas.getContext("2d"), fitted: false });
  }

  // Fit the view to the canvas. To ask for its size is slow, so it is asked only after a change.
  fit() {
    const { canvas, low, high } = this;
    this.ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.round(size * this.ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.scale = Math.min(width / (high[0] - low[0] + 2 * VIEW_BESIDE), height / (high[1] - low[1] + 2 * VIEW_BESIDE));
    this.fitted = true;
  }

  begin() {
    if (!this.fitted) this.fit();
    this.pen.fillStyle = hue("ground");
    this.pen.fillRect(0, 0, this.canvas.width, this.canvas.height);
  }

  at(x, z) {
    const { canvas, low, high, scale } = this;
    return [canvas.width / 2 + scale * (x - (low[0] + high[0]) / 2), canvas.height / 2 - scale * (z - (low[1] + high[1]) / 2)];
  }

  // Draw lines, each a list of places, as one path.
  lines(lines, colour, wide, { dash = [], alpha = 1 } = {}) {
    const { pen, ratio } = this;
    pen.beginPath();
    for (const places of lines) places.forEach((place, i) => pen[i ? "lineTo" : "moveTo"](...this.at(...place)));
    Object.assign(pen, { strokeStyle: colour, lineWidth: wide * ratio, globalAlpha: alpha });
    pen.setLineDash(dash.map((length) => length * ratio));
    pen.stroke();
    pen.globalAlpha = 1;
  }

  fill(polygons, colour) {
    const { pen } = this;
    pen.beginPath();
    for (const places of polygons) places.forEach((place, i) => pen[i ? "lineTo" : "moveTo"](...this.at(...place)));
    pen.fillStyle = colour;
    pen.fill();
  }

  // Draw a disc with a radius in pixels of the page, and a rim if asked for.
  disc(place, radius, colour, { alpha = 1, rim = false } = {}) {
    const { pen, ratio } = this;
    pen.beginPath();
    pen.arc(...this.at(...place), radius * ratio, 0, 2 * Math.PI);
    Object.assign(pen, { fillStyle: colour, strokeStyle: colour, lineWidth: ratio, globalAlpha: alpha });
    pen.fill();
    pen.globalAlpha = 1;
    pen.setLineDash([]);
    if (rim) pen.stroke();
  }

  word(text, place, colour) {
    const { pen, ratio } = this, [x, y] = this.at(...place);
    Object.assign(pen, { font: `600 ${13 * ratio}px system-ui, sans-serif`, lineJoin: "round", lineWidth: 4 * ratio, strokeStyle: hue("ground"), fillStyle: colour });
    pen.setLineDash([]);
    pen.strokeText(text, x + 8 * ratio, y + 18 * ratio);
    pen.fillText(text, x + 8 * ratio, y + 18 * ratio);
  }
}

class SectionPicture {
  constructor(canvas, flight, tail) {
    const { live, cells, beside, faces, start, meta } = flight, xs = live.box.map((corner) => corner[0]), zs = live.box.map((corner) => corner[2]);
    Object.assign(this, { flight, tail, low: [Math.min(...xs), Math.min(...zs)], high: [Math.max(...xs), Math.max(...zs)] });
    this.plot = new Plot(canvas, this.low, this.high);
    this.own = new Section(flight, live, cells, live.cells);
    this.beside = new Section(flight, live, beside, [...Array(beside.length / 4).keys()]);
    this.walls = [];
    const height = (node) => start[3 * node + 1] - meta.section;
    for (let t = 0; t < faces.length; t += 3) {
      const edges = [0, 1, 2].map((k) => [faces[t + k], faces[t + (k + 1) % 3]]).filter(([a, b]) => (height(a) >= 0) !== (height(b) >= 0));
      if (edges.length === 2) this.walls.push(edges.map(([a, b]) => [a, b, height(a) / (height(a) - height(b))]));
    }
  }

  // Draw the mesh with nodes at points, and what a step shows: `parts`, `lattice`, `jump`, `inverted`, `errors`, `centres`.
  draw({ points, before, now, field, angle, shows }) {
    const { plot, tail, low, high } = this, values = this.flight.live.values(angle), held = tail.holds(field);
    plot.begin();
    if (shows.parts) this.drawParts(field, shows.parts, values, angle);
    else this.drawMesh(points, before, now, shows.lattice ? 0.4 : 0.8);
    if (shows.lattice) this.drawLattice(field, values, held);
    const between = (a, b, share) => [0, 2].map((c) => points[3 * a + c] + share * (points[3 * b + c] - points[3 * a + c]));
    plot.lines(this.walls.map((ends) => ends.map((end) => between(...end))), hue("moves"), 2.4);
    plot.lines([[low, [high[0], low[1]], high, [low[0], high[1]], low]], hue("box"), 1.6, { dash: [6, 4] });
    for (let i = tail.inMesh; held && !shows.parts && i < tail.count; i += 1) {
      if (this.off(i) < 0.75 * NEAR) plot.disc(this.site(i), 2.2, hue("box"));
    }
    if (shows.jump && !held) this.drawJump(field, values);
    if (shows.inverted) this.drawInverted(points, now);
    if (shows.errors) this.drawErrors(field, angle);
    for (const i of shows.centres ? field.centres || [] : []) {
      const near = this.off(i) < NEAR;
      plot.disc(this.site(i), near ? 4.5 : 3.2, hue("ink"), { alpha: near ? 1 : 0.45 });
    }
    if (shows.parts) this.drawWanted(field, shows.parts, values);
    plot.word("the box", [low[0], high[1]], hue("soft"));
  }

  // Place of a site in the section, and its distance from the plane.
  site(i) {
    return [this.tail.sites[3 * i], this.tail.sites[3 * i + 2]];
  }

  off(i) {
    return Math.abs(this.tail.sites[3 * i + 1] - this.flight.meta.section);
  }

  drawMesh(points, before, now, wide) {
    const { plot, own, beside } = this, place = (section, i) => [section.points[3 * i], section.points[3 * i + 2]];
    const triangles = Array.from({ length: SHADES + 1 }, () => []);
    for (const section of [own, beside]) section.follow(points);
    own.rows.forEach((row, i) => {
      const level = shade(before[row], now[row]);
      if (level >= 0) triangles[level].push([0, 1, 2].map((k) => place(own, own.triangles[3 * i + k])));
    });
    triangles.forEach((some, level) => plot.fill(some, level === SHADES ? hue("inverted") : css(mixed(hue("ground"), hue("worse"), 0.15 + 0.85 * level / (SHADES - 1)))));
    for (const [section, width] of [[beside, 0.5], [own, wide]]) {
      const pairs = Array.from({ length: section.lines.length / 2 }, (_, i) => [place(section, section.lines[2 * i]), place(section, section.lines[2 * i + 1])]);
      plot.lines(pairs, hue("cells"), width);
    }
  }

  drawLattice(field, values, held) {
    const { rows } = this.tail.lattice, move = [0, 0, 0], parts = [];
    const moved = rows.map((row) => row.map(([x, z, i]) => {
      if (i < 0) return [x, z];
      displaced(field.lattice, this.tail.columns, values, i, move);
      return [x + move[0], z + move[2]];
    }));
    rows.forEach((row, j) => row.forEach(([, , own], i) => {
      for (const [m, n] of [[j, i - 1], [j - 1, i]]) {
        // Lines are cut at the box where the field jumps.
        if (m >= 0 && n >= 0 && (held || (own < 0) === (rows[m][n][2] < 0))) parts.push([moved[m][n], moved[j][i]]);
      }
    }));
    this.plot.lines(parts, hue("ink"), 0.7, { alpha: 0.45 });
  }

  // How far a field that is not held would move the box itself.
  drawJump(field, values) {
    const { tail, low, high, flight: { meta } } = this, rim = [], move = [0, 0, 0];
    for (let i = 0; i < RIM; i += 1) {
      const x = low[0] + i / RIM * (high[0] - low[0]), z = low[1] + i / RIM * (high[1] - low[1]);
      rim.push([x, low[1]], [high[0], z], [low[0] + high[0] - x, high[1]], [low[0], low[1] + high[1] - z]);
    }
    field.rim = field.rim || field.found.at(Float64Array.from(rim.flatMap(([x, z]) => [x, meta.section, z])));
    const arrows = rim.map(([x, z], i) => {
      displaced(field.rim, tail.columns, values, i, move);
      return [[x, z], [x + move[0], z + move[2]]];
    });
    this.plot.lines(arrows, hue("worse"), 1.5);
  }

  // All edges of the cells that are inside out, also of those beside the section.
  drawInverted(points, now) {
    const { cells, live } = this.flight, edges = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    const inverted = [];
    for (const row of live.cells) if (now[row] < 0) inverted.push(row);
    const place = (row, k) => [0, 2].map((c) => points[3 * cells[4 * row + k] + c]);
    this.plot.lines(inverted.flatMap((row) => edges.map((pair) => pair.map((k) => place(row, k)))), hue("inverted"), 1.2);
  }

  drawErrors(field, angle) {
    const { plot } = this, radius = (SPOT * plot.scale) / plot.ratio;
    this.tail.errors(field, angle).forEach((error, i) => {
      if (error > LEAST && this.off(i) < NEAR) plot.disc(this.site(i), radius * error, hue("worse"), { alpha: 0.2, rim: true });
    });
  }

  // How far the first `count` parts of the sum would move each place: the functions one by one, then the linear part.
  drawParts(field, count, values, angle) {
    const { plot, tail, low, high, flight: { meta } } = this, rows = Math.round(COLUMNS * (high[1] - low[1]) / (high[0] - low[0]));
    const most = Math.min(count, field.centres.length), move = [0, 0, 0];
    if (!field.parts || field.parts.count !== count) {
      const places = Float64Array.from({ length: 3 * COLUMNS * rows }, (_, k) => {
        const [i, j] = [Math.floor(k / 3) % COLUMNS, Math.floor(k / 3 / COLUMNS)];
        return [low[0] + (i + 0.5) / COLUMNS * (high[0] - low[0]), meta.section, high[1] - (j + 0.5) / rows * (high[1] - low[1])][k % 3];
      });
      field.parts = { count, values: field.found.at(places, most, count > most) };
    }
    const sizes = Float64Array.from({ length: COLUMNS * rows }, (_, i) => Math.hypot(...displaced(field.parts.values, tail.columns, values, i, move)));
    this.top = Math.max(...sizes, 1e-9);
    this.scale = Math.max(0.01, Math.ceil(100 * tail.motion(tail.values, 0, tail.onTail, angle)) / 100); // m, for all numbers of parts
    const bands = this.bands = Array.from({ length: BANDS }, (_, i) => mixed(hue("ground"), hue("moves"), 0.05 + 0.75 * i / (BANDS - 1))), picture = new ImageData(COLUMNS, rows);
    sizes.forEach((size, i) => picture.data.set([...bands[Math.min(BANDS - 1, Math.floor(BANDS * size / this.scale))], 255], 4 * i));
    const small = Object.assign(document.createElement("canvas"), { width: COLUMNS, height: rows });
    small.getContext("2d").putImageData(picture, 0, 0);
    plot.pen.drawImage(small, ...plot.at(low[0], high[1]), plot.scale * (high[0] - low[0]), plot.scale * (high[1] - low[1]));
  }

  // Bars at centres and at the tail: where each should go, and where the sum takes it; a ring around the newest centre;
  // and the scale of the colours.
  drawWanted(field, count, values) {
    const { plot, tail, high, low } = this, { pen, ratio } = plot, own = field.centres, most = Math.min(count, own.length), move = [0, 0, 0];
    const at = [...own, ...Array(tail.onTail).keys()].filter((i) => own.includes(i) || this.off(i) < NEAR);
    if (!field.sums || field.sums.count !== count) {
      const places = Float64Array.from(at.flatMap((i) => Array.from(tail.sites.subarray(3 * i, 3 * i + 3))));
      field.sums = { count, values: field.found.at(places, most, count > most) };
    }
    const bar = (found, k, i) => {
      displaced(found, tail.columns, values, k, move);
      const [x, z] = this.site(i);
      return [[x, z], [x + move[0], z + move[2]]];
    };
    plot.lines(at.map((i) => bar(tail.values, i, i)), hue("soft"), 5, { alpha: 0.6 });
    plot.lines(at.map((i, k) => bar(field.sums.values, k, i)), hue("worse"), 1.6);
    if (count <= most) {
      pen.beginPath();
      pen.arc(...plot.at(...this.site(own[count - 1])), 9 * ratio, 0, 2 * Math.PI);
      Object.assign(pen, { strokeStyle: hue("worse"), lineWidth: 1.6 * ratio });
      pen.stroke();
    }
    const [right, top] = plot.at(...high), wide = 120 * ratio, tall = 10 * ratio, left = right - wide - 8 * ratio, begin = top + 24 * ratio;
    pen.fillStyle = hue("ground");
    pen.fillRect(left - 6 * ratio, begin - 18 * ratio, wide + 12 * ratio, tall + 24 * ratio);
    for (let i = 0; i < BANDS; i += 1) {
      pen.fillStyle = css(this.bands[i]);
      pen.fillRect(left + wide * i / BANDS, begin, wide / BANDS + 1, tall);
    }
    Object.assign(pen, { fillStyle: hue("ink"), font: `${12 * ratio}px system-ui, sans-serif`, textAlign: "left" });
    pen.fillText("0", left, begin - 4 * ratio);
    pen.textAlign = "right";
    pen.fillText(`${Math.round(1e3 * this.scale)} mm`, left + wide, begin - 4 * ratio);
    pen.textAlign = "left";
  }
}
