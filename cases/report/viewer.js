// Draws the picture from the JSON in #scene-data and the arrays in #scene-arrays with three.js, which is in
// #scene-library; all three are compressed. Names of the data go through textContent alone.
(async () => {
  const plot = document.getElementById("turnable");
  const control = (name) => document.getElementById("scene-" + name);

  const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0)).buffer;

  const inflated = async (name) => {
    const packed = new Blob([bytes(document.getElementById(name).textContent)]);
    return new Response(packed.stream().pipeThrough(new DecompressionStream("gzip")));
  };

  function drawable() {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }

  function without(reason) {
    for (const one of document.querySelectorAll(".tools, .panel")) one.hidden = true;
    plot.classList.add("empty");
    plot.textContent = "The picture cannot be drawn: " + reason + " All else on this page is complete.";
  }

  // On paper nothing can be opened.
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll("details:not([open])")];
    opened.forEach((one) => { one.open = true; });
  });
  window.addEventListener("afterprint", () => opened.forEach((one) => { one.open = false; }));

  document.getElementById("interactive-body").hidden = false;
  if (!drawable()) return without("this browser offers no WebGL.");
  if (typeof DecompressionStream === "undefined") return without("this browser is older than 2023.");
  const data = JSON.parse(await (await inflated("scene-data")).text());
  const arrays = await (await inflated("scene-arrays")).arrayBuffer();

  // Arrays are stored one after another, of each the first bytes of all its numbers, then the second ones, and so on.
  function array([start, count]) {
    const found = new Uint8Array(arrays, start, 4 * count), out = new Uint8Array(4 * count);
    for (let i = 0; i < count; i += 1) for (let k = 0; k < 4; k += 1) out[4 * i + k] = found[k * count + i];
    return out.buffer;
  }
  const numbers = (place) => new Float32Array(array(place));
  const indices = (place) => new Uint32Array(array(place));
  const lengthsOf = (place) => numbers(place).map((value) => data.factor * value);
  const single = (values) => Float32Array.from(values);
  // Numbers with what single precision leaves of them, in the unit of the picture.
  function doubles(high, low) {
    const out = Float64Array.from(numbers(high), (value) => data.factor * value);
    if (low) numbers(low).forEach((value, i) => { out[i] += data.factor * value; });
    return out;
  }

  // Colours of the page's style sheet; of its light scheme for paper.
  const hue = (name, where = document.documentElement) => getComputedStyle(where).getPropertyValue(`--${name}`).trim();
  const signed = (amount, unit) => {
    const number = Number(amount.toPrecision(4)), text = `${number < 0 ? "\u2212" : number ? "+" : ""}${Math.abs(number)}`;
    return unit === "deg" ? `${text}\u00b0` : `${text} ${unit}`;
  };

  // What turns the mesh: the functions of each surface's amount, times the fields of a part.
  const turned = data.turn ? data.turn.surfaces : [], own = turned.map((one) => one.own);
  const RADIANS = Math.PI / 180;
  const FUNCTIONS = {
    Turn: ({ count }, amount) => Array.from({ length: count }, (_, i) => {
      const angle = RADIANS * amount * (1 + (i >> 1));
      return i % 2 ? 2 * Math.sin(angle / 2) ** 2 : Math.sin(angle);
    }),
    Samples: ({ low, high, values }, amount) => {
      const place = (values.length - 1) * (amount - low) / (high - low), row = Math.min(Math.floor(place), values.length - 2);
      return values[row].map((value, k) => value + (place - row) * (values[row + 1][k] - value));
    },
    Powers: ({ count, scale }, amount) => Array.from({ length: count }, (_, i) => (amount / scale) ** (i + 1)),
  };
  const isOwn = (amounts) => amounts.every((one, i) => one === own[i]);
  function placed(part, amounts) {
    const out = part.start.slice();
    for (const mode of part.modes) {
      const { functions } = turned[mode.surface], values = FUNCTIONS[functions.kind](functions, amounts[mode.surface]);
      if (!amounts[mode.surface]) continue;
      for (let k = 0; k < values.length; k += 1) {
        const field = mode.fields[k], value = values[k];
        for (let i = 0; i < mode.at.length; i += 1) {
          const row = 3 * mode.at[i];
          for (let c = 0; c < 3; c += 1) out[row + c] += value * field[3 * i + c];
        }
      }
    }
    if (part.rest && isOwn(amounts)) part.rest.forEach((value, i) => { out[i] += value; });
    return out;
  }

  function unpacked(part) {
    const start = doubles(part.points, part.points_low), modes = part.modes.map((mode) => ({
      ...mode, at: indices(mode.at), fields: mode.fields.map((field, k) => doubles(field, mode.fields_low && mode.fields_low[k])) }));
    const rest = part.rest ? doubles(part.rest, part.rest_low) : null, whole = { ...part, start, modes, rest };
    const after = placed(whole, own), mended = part.unrepaired ? doubles(part.unrepaired) : null;
    const between = mended ? after.map((value, i) => value + mended[i]) : after;
    return {
      ...whole, points: single(start), moved: single(after), aimed: single(after), interpolated: single(between),
      exact: { undeflected: start, deflected: after, interpolated: between },
      turns: modes.length > 0, faces: indices(part.faces),
    };
  }

  const patches = data.patches.map(unpacked).map((patch) => (
    { ...patch, edges: patch.edges ? indices(patch.edges) : edges(patch) }));
  const groups = data.cells.groups.map(unpacked).map((group) => {
    const cell = group.cell ? indices(group.cell) : null, rows = indices(group.rows), known = group.qualities && group.qualities.map(numbers);
    const whole = { ...group, cell, rows, known, quality: {} };
    for (const name of ["undeflected", "deflected", "interpolated"]) whole.quality[name] = judged(whole, name, own);
    return whole;
  });
  // Cells of no type are measured by the product alone: linearly between the amounts at which it did so.
  function judged(group, name, amounts) {
    if (!group.known) return measured(group.shape, group.exact[name], group.faces, group.corners, group.sign, new Float64Array(group.rows.length));
    const [before, after, between, ...poses] = group.known, out = Float64Array.from({ undeflected: before, deflected: after, interpolated: between }[name]);
    if (name !== "deflected") return out;
    let first = 0;
    turned.forEach(({ measured: rows, own: from }, i) => {
      for (const [amount, sign] of [[amounts[i], 1], [from, -1]]) {
        const [k, share] = around(rows, amount);
        out.forEach((value, cell) => { out[cell] = value + sign * ((1 - share) * poses[first + k][cell] + share * poses[first + k + 1][cell]); });
      }
      first += rows.length;
    });
    return out;
  }
  // The row of the measured amount below another, and the share of the way to the next one.
  function around(rows, amount) {
    const above = rows.findIndex((row) => row.amount >= amount), k = Math.max(1, above < 0 ? rows.length - 1 : above) - 1;
    return [k, Math.min(1, Math.max(0, (amount - rows[k].amount) / (rows[k + 1].amount - rows[k].amount)))];
  }
  const boxes = data.boxes.map((box) => lengthsOf(box.segments));
  const dots = data.dots.map((one) => ({ ...one, points: lengthsOf(one.points) }));
  let state = "deflected";

  const at = (part) => ({ undeflected: part.points, interpolated: part.interpolated, deflected: part.moved })[state];
  const distances = (part, points) => Float32Array.from({ length: points.length / 3 }, (_, i) => (
    Math.hypot(...[0, 1, 2].map((c) => points[3 * i + c] - part.points[3 * i + c]))));
  const moving = patches.filter((one) => one.goes || one.turns);
  const CREASE = Math.cos(35 * Math.PI / 180);
  const farthest = () => Math.max(0, ...moving.map((one) => distances(one, one.moved).reduce((most, each) => Math.max(most, each), 0)));
  const coloured = () => control("colour").value;
  const viewed = () => data.views[control("view").value];
  const shownPatches = new Set(patches.filter((one) => !one.hidden).map((one) => one.name));

  // The edges of triangles or of plane cells, each once.
  function edges({ faces, corners }) {
    const seen = new Map();
    for (let i = 0; i < faces.length; i += 1) {
      const pair = [faces[i], faces[(i + 1) % corners ? i + 1 : i + 1 - corners]].sort((p, q) => p - q);
      seen.set(pair[0] * 4294967296 + pair[1], pair);
    }
    return Uint32Array.from(Array.from(seen.values()).flat());
  }

  // The edges that show a patch's shape: its border, and those at which its faces turn.
  function features({ faces, points, edges: every }) {
    const sides = new Map(), key = (p, q) => (p < q ? p * 4294967296 + q : q * 4294967296 + p), normals = [];
    for (let i = 0; i < faces.length; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => 3 * faces[i + k]), u = [], v = [];
      for (let k = 0; k < 3; k += 1) { u.push(points[b + k] - points[a + k]); v.push(points[c + k] - points[a + k]); }
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], size = Math.hypot(...n) || 1;
      normals.push(n.map((value) => value / size));
      for (let k = 0; k < 3; k += 1) {
        const side = key(faces[i + k], faces[i + (k + 1) % 3]);
        if (sides.has(side)) sides.get(side).push(i / 3); else sides.set(side, [i / 3]);
      }
    }
    const out = [];
    for (let i = 0; i < every.length; i += 2) {
      const two = sides.get(key(every[i], every[i + 1])) || [];
      const turn = two.length === 2 ? normals[two[0]].reduce((sum, value, k) => sum + value * normals[two[1]][k], 0) : -1;
      if (turn < CREASE) out.push(every[i], every[i + 1]);
    }
    return Uint32Array.from(out);
  }

  // Segments (S, 6) cut into dashes of one length with gaps as long.
  function dashed(segments, length) {
    const out = [];
    for (let i = 0; i < segments.length; i += 6) {
      const from = segments.slice(i, i + 3), way = [0, 1, 2].map((c) => segments[i + 3 + c] - from[c]);
      const count = Math.max(1, Math.min(400, Math.round(Math.hypot(...way) / length / 2)));
      for (let k = 0; k < count; k += 1) for (const end of [k, k + 0.5]) out.push(...from.map((value, c) => value + way[c] * end / count));
    }
    return single(out);
  }

  // The axis (-1: none) and the place of the section.
  function section() {
    const axis = "xyz".indexOf(control("axis").value), { low, high } = viewed();
    return [axis, axis < 0 ? 0 : low[axis] + Number(control("place").value) / 100 * (high[axis] - low[axis])];
  }

  // Whether the plane of the section cuts a cell, by its row of nodes.
  function cutter(group) {
    const [axis, place] = section(), points = at(group);
    if (axis < 0) return () => true;
    return (first, corners) => {
      let above = false, below = false;
      for (let i = first; i < first + corners; i += 1) {
        if (points[3 * group.faces[i] + axis] < place) below = true; else above = true;
      }
      return above && below;
    };
  }

  const LARGE = 150_000; // corners of triangles: from here on a renderer in software takes too long to smooth their edges
  const sizes = patches.reduce((sum, one) => sum + one.faces.length, 0);
  function drawn() {
    const renderer = new THREE.WebGLRenderer({ antialias: sizes < LARGE, alpha: true, preserveDrawingBuffer: true });
    const canvas = renderer.domElement, scene = new THREE.Scene(), camera = new THREE.OrthographicCamera();
    const light = new THREE.DirectionalLight("#ffffff", 1.3);
    renderer.setPixelRatio(window.devicePixelRatio);
    renderer.autoClear = false;
    renderer.localClippingEnabled = true;
    const knife = new THREE.Plane();
    camera.up.set(0, data.plane ? 1 : 0, data.plane ? 0 : 1);
    light.position.set(-0.4, 0.8, 1);
    camera.add(light, light.target);
    light.target.position.set(0, 0, -1);
    scene.add(camera, new THREE.AmbientLight("#ffffff", 2.1));
    plot.append(canvas);
    const controls = new THREE.OrbitControls(camera, canvas);
    controls.enableRotate = !data.plane;
    controls.zoomToCursor = true;

    const positions = (points) => new THREE.BufferAttribute(points, 3);
    const extent = (points) => Math.hypot(...[0, 1, 2].map((c) => {
      let [low, high] = [Infinity, -Infinity];
      for (let i = c; i < points.length; i += 3) { low = Math.min(low, points[i]); high = Math.max(high, points[i]); }
      return high - low;
    }));
    let amounts = own.slice(), chosen = ""; // the patch that was clicked, in a mesh in which nothing moves
    function segments(points, pairs) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", points);
      if (pairs) geometry.setIndex(new THREE.BufferAttribute(pairs, 1));
      const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ clippingPlanes: [] }));
      lines.frustumCulled = false;
      scene.add(lines);
      return lines;
    }
    function solid() {
      const material = new THREE.MeshLambertMaterial({
        flatShading: true, side: THREE.DoubleSide, clippingPlanes: [], polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
      const mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
      mesh.frustumCulled = false;
      scene.add(mesh);
      return mesh;
    }
    for (const patch of patches) {
      const shared = positions(Float32Array.from(patch.moved));
      patch.mesh = solid();
      patch.mesh.patch = patch;
      patch.mesh.geometry.setAttribute("position", shared);
      patch.mesh.geometry.setIndex(new THREE.BufferAttribute(patch.faces, 1));
      patch.wire = segments(shared, patch.edges);
      const shape = data.plane ? patch.edges : features(patch), size = extent(patch.points);
      patch.frame = segments(shared, shape);
      patch.ghost = patch.surface ? segments(positions(dashed(Array.from(shape).flatMap((i) => Array.from(patch.points.subarray(3 * i, 3 * i + 3))), size / 90))) : null;
    }
    for (const group of groups) {
      group.mesh = solid();
      if (data.plane) group.wire = segments(positions(single(group.moved)), edges(group));
    }
    const outlines = boxes.map((points) => segments(positions(dashed(Array.from(points), extent(points) / 160))));
    const crossed = segments(positions(lengthsOf(data.crossed.segments))); // faces that go through others
    crossed.material.depthTest = false;
    crossed.renderOrder = 4;
    const shard = solid(); // the worst cell, seen through all else
    shard.material.depthTest = false;
    shard.renderOrder = 5;
    const clouds = dots.map((one) => {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", positions(one.points));
      const cloud = new THREE.Points(geometry, new THREE.PointsMaterial({ color: one.colour, size: 4, sizeAttenuation: false }));
      cloud.frustumCulled = false;
      scene.add(cloud);
      return cloud;
    });

    // Colours of a scale: 256 of them, in the linear space in which three.js blends.
    const scales = new Map();
    function colours(scale) {
      if (!scales.has(scale)) {
        scales.set(scale, Float32Array.from(Array.from({ length: 256 }, (_, i) => {
          const share = i / 255 * (scale.length - 1), low = Math.min(Math.floor(share), scale.length - 2);
          return new THREE.Color(scale[low][1]).lerp(new THREE.Color(scale[low + 1][1]), share - low).toArray();
        }).flat()));
      }
      return scales.get(scale);
    }
    function shades(values, scale, [low, high]) {
      const table = colours(scale), out = new Float32Array(3 * values.length);
      values.forEach((value, i) => {
        const colour = 3 * Math.max(0, Math.min(255, Math.round(255 * (value - low) / (high - low || 1))));
        for (let c = 0; c < 3; c += 1) out[3 * i + c] = table[colour + c];
      });
      return new THREE.BufferAttribute(out, 3);
    }
    function bar(title, scale, [low, high]) {
      control("bar").hidden = false;
      control("bar-title").textContent = title;
      control("bar-colours").style.background = `linear-gradient(to right, ${scale.map((one) => one[1]).join(", ")})`;
      control("bar-low").textContent = low.toPrecision(3);
      control("bar-high").textContent = high.toPrecision(3);
    }

    // The colours follow the scheme of the page; a picture for paper has the light ones.
    const scheme = matchMedia("(prefers-color-scheme: dark)"), paper = document.querySelector(".light");
    let where = document.documentElement;
    function inked(scope) {
      where = scope;
      patches.forEach(surface);
      for (const one of outlines) one.material.color.set(hue("box", where));
      for (const group of data.plane ? groups : []) group.wire.material.color.set(hue("cells", where));
      for (const one of [shard, crossed]) one.material.color.set(hue("worse", where));
    }
    scheme.addEventListener("change", () => { inked(document.documentElement); redraw(); });

    function surface(patch, row) {
      const visible = shownPatches.has(patch.name);
      const shared = patch.mesh.geometry.getAttribute("position"), shaded = coloured() === "displacement";
      const cut = section()[0] < 0 ? [] : [knife];
      if (patch.drawn !== at(patch)) {
        patch.drawn = at(patch);
        shared.array.set(patch.drawn);
        shared.needsUpdate = true;
      }
      for (const one of [patch.mesh, patch.wire, patch.frame]) one.material.clippingPlanes = cut;
      patch.wire.material.color.set(hue(patch.surface ? "edge" : "cells", where));
      patch.wire.material.opacity = patch.surface ? 0.35 : 1;
      patch.wire.material.transparent = patch.surface;
      patch.frame.material.color.set(hue(data.plane && patch.surface ? "moves" : "edge", where));
      if (shaded) patch.mesh.geometry.setAttribute("color", shades(distances(patch, at(patch)), data.colours.displacement, [0, farthest()]));
      patch.mesh.material.vertexColors = shaded;
      patch.mesh.material.color.set(shaded ? "#ffffff" : hue(patch.surface || chosen === patch.own ? "moves" : "stays", where));
      if (patch.panel && !shaded) patch.mesh.material.color.lerp(new THREE.Color(hue("stays", where)), 0.65);
      if (!shaded && !boxes.length && chosen !== patch.own) patch.mesh.material.color.multiplyScalar(1 - 0.09 * (row % 3)); // neighbours differ where nothing moves
      patch.mesh.material.needsUpdate = true;
      patch.mesh.visible = visible && !data.plane;
      patch.wire.visible = visible && control("lines").checked && !data.plane;
      patch.frame.visible = visible && (!data.plane || where === paper);
      if (!patch.ghost) return;
      patch.ghost.material.color.set(hue("edge", where));
      patch.ghost.visible = visible && control("overlay").checked && state !== "undeflected";
    }

    // Fill the triangles around the cells of a group that are below the threshold and in the section.
    function outside(group, threshold, change, table, [low, high]) {
      const values = group.quality[state], before = group.quality.undeflected, points = at(group), cut = cutter(group);
      const rows = group.faces.length / group.corners, most = rows * group.table.length, whole = section()[0] >= 0;
      if (!group.mesh.geometry.getAttribute("position")) {
        for (const name of ["position", "color"]) group.mesh.geometry.setAttribute(name, positions(new Float32Array(3 * most)));
      }
      const [place, shade] = ["position", "color"].map((name) => group.mesh.geometry.getAttribute(name));
      let filled = 0;
      for (let row = 0; row < rows; row += 1) {
        const cell = group.cell ? group.cell[row] : row, first = row * group.corners;
        const value = change ? values[cell] - before[cell] : values[cell];
        if ((change && !whole ? value > -data.colours.lost : values[cell] >= threshold) || !cut(first, group.corners)) continue;
        const colour = 3 * Math.max(0, Math.min(255, Math.round(255 * (value - low) / (high - low || 1))));
        for (let t = 0; t < group.table.length; t += 3) {
          for (let k = 0; k < 3; k += 1) {
            const node = 3 * group.faces[first + group.table[t + (3 - k) % 3]];
            for (let c = 0; c < 3; c += 1) {
              place.array[filled] = points[node + c];
              shade.array[filled] = table[colour + c];
              filled += 1;
            }
          }
        }
      }
      group.mesh.geometry.setDrawRange(0, filled / 3);
      place.needsUpdate = shade.needsUpdate = true;
    }

    function cells() {
      const threshold = Number(control("threshold").value), change = coloured() === "change";
      let [count, inverted] = [0, 0];
      for (const group of groups) {
        for (const value of group.quality[state]) {
          if (value < threshold) count += 1;
          if (value <= 0) inverted += 1;
        }
      }
      control("count").textContent = `${count} of ${data.cells.all} cells below ${threshold.toFixed(2)}, ${inverted} inverted`;
      const [axis, place] = section();
      const some = data.cells.shown < data.cells.all ? `, through the worst ${data.cells.shown} of ${data.cells.all} cells alone` : "";
      control("where").textContent = axis < 0 ? "" : `${"xyz"[axis]} = ${place.toPrecision(4)} ${data.unit}${some}`;
      for (const group of data.plane ? groups : []) { // a plane mesh is its lines
        const shared = group.wire.geometry.getAttribute("position");
        shared.array.set(at(group));
        shared.needsUpdate = true;
        group.wire.visible = control("lines").checked;
      }
      const [scale, range] = change ? [data.colours.change, data.colours.changes] : [data.colours.shades, data.colours.range];
      for (const group of groups) {
        group.mesh.visible = control("cells").checked && (change || count > 0);
        group.mesh.material.vertexColors = true;
        if (group.mesh.visible) outside(group, threshold, change, colours(scale), range);
      }
      control("bar").hidden = true;
      if (coloured() === "displacement") bar("displacement, " + data.unit, data.colours.displacement, [0, farthest()]);
      else if (control("cells").checked && (change || count)) bar(change ? "change of " + data.measure : data.measure, scale, range);
    }

    // A small cross in a corner says where x, y and z are.
    const cross = new THREE.Scene(), corner = new THREE.OrthographicCamera(-1.5, 1.5, 1.5, -1.5, 0, 20);
    ["#c0392b", "#2e8b57", "#2c6fbb"].slice(0, data.plane ? 2 : 3).forEach((colour, c) => {
      const end = [0, 0, 0], image = document.createElement("canvas"), geometry = new THREE.BufferGeometry();
      end[c] = 1;
      geometry.setAttribute("position", positions(Float32Array.from([0, 0, 0, ...end])));
      image.width = image.height = 64;
      const pen = image.getContext("2d");
      pen.font = "bold 48px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillStyle = colour;
      pen.fillText("xyz"[c], 32, 46);
      const label = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(image), depthTest: false }));
      label.position.fromArray(end).multiplyScalar(1.25);
      label.scale.setScalar(0.7);
      cross.add(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour })), label);
    });

    function render() {
      const [wide, high] = [plot.clientWidth, plot.clientHeight];
      const [axis, place] = section();
      if (axis >= 0) { // patches are cut away on the eye's side
        const side = Math.sign(camera.position.getComponent(axis) - controls.target.getComponent(axis)) || 1;
        knife.normal.set(0, 0, 0).setComponent(axis, -side);
        knife.constant = side * place;
      }
      renderer.setViewport(0, 0, wide, high);
      renderer.clear();
      renderer.render(scene, camera);
      corner.position.copy(camera.position).sub(controls.target).setLength(10);
      corner.quaternion.copy(camera.quaternion);
      renderer.setViewport(12, 12, 72, 72);
      renderer.clearDepth();
      renderer.render(cross, corner);
      const length = 200 * (camera.right - camera.left) / camera.zoom / wide, power = 10 ** Math.floor(Math.log10(length));
      const round = [1, 2, 5].map((one) => one * power).filter((one) => one <= length).pop();
      control("bar-of-scale").style.width = `${200 * round / length}px`;
      control("text").textContent = `${round.toPrecision(1) * 1} ${data.unit}`;
      marked();
    }

    // Names, the worst cell and a picked hinge are written over the picture, where their places are seen.
    const SVG = "http://www.w3.org/2000/svg", LINE = 18;
    function element(name, attributes, text) {
      const one = document.createElementNS(SVG, name);
      Object.entries(attributes).forEach(([key, value]) => one.setAttribute(key, value));
      if (text) one.textContent = text;
      return one;
    }
    function onScreen(place) {
      const seen = new THREE.Vector3(...place).project(camera);
      return [(seen.x + 1) / 2 * plot.clientWidth, (1 - seen.y) / 2 * plot.clientHeight];
    }
    const named = data.labels.map((label) => ({ ...label, patch: patches.find((one) => one.own === label.own) }));
    function said({ name, control: of, amount }) {
      const i = turned.findIndex((one) => one.name === of);
      if (!amount || state === "undeflected") return name;
      return `${name} ${i < 0 ? amount : signed(amounts[i], turned[i].unit)}`;
    }
    function marked() {
      const [wide, high] = [plot.clientWidth, plot.clientHeight], layer = control("labels"), taken = [];
      layer.replaceChildren();
      for (const patch of data.plane ? patches.filter((one) => shownPatches.has(one.name)) : []) { // walls of a plane mesh
        const points = at(patch), seen = (i) => onScreen(points.subarray(3 * i, 3 * i + 3)).map((value) => value.toFixed(1)).join(" ");
        let d = "";
        for (let i = 0; i < patch.edges.length; i += 2) d += `M${seen(patch.edges[i])}L${seen(patch.edges[i + 1])}`;
        layer.append(element("path", { class: patch.surface ? "moves" : "stays", d }));
      }
      const first = named.filter((one) => one.own === chosen);
      for (const label of lowest ? [] : [...first, ...named.filter((one) => one.own !== chosen)]) {
        if (!shownPatches.has(label.patch.name)) continue;
        const points = at(label.patch), [x, y] = onScreen(points.subarray(3 * label.row, 3 * label.row + 3));
        if (x < 0 || y < 0 || x > wide || y > high) continue;
        const text = said(label), width = 7.4 * text.length, right = x > wide / 2;
        const left = Math.min(Math.max(6, right ? x + 8 : x - 8 - width), wide - width - 6);
        let base = y < high / 2 ? y - 22 : y + 34;
        const apart = (one) => left > one[0] + one[2] || left + width < one[0] || Math.abs(base - one[1]) >= LINE;
        if (!boxes.length && !taken.every(apart)) continue; // its name is in the list of patches
        for (let k = 0; k < 12 && !taken.every(apart); k += 1) base += y < high / 2 ? -LINE : LINE;
        base = Math.min(Math.max(base, 16), high - 30);
        taken.push([left, base, width]);
        layer.append(element("line", { x1: x, y1: y, x2: Math.min(Math.max(x, left), left + width), y2: base < y ? base + 4 : base - 12 }),
          element("circle", { class: "dot", cx: x, cy: y, r: 3.5 }), element("text", { x: left, y: base }, text));
      }
      if (lowest) ringed(layer);
      if (ends.length) hinged(layer);
    }

    let asked = 0, pending = 0;
    function redraw() {
      cancelAnimationFrame(asked);
      asked = requestAnimationFrame(render);
      clearTimeout(pending);
      pending = setTimeout(keep, 800); // what is printed is the picture as it was seen last
    }
    function pictured() {
      renderer.setClearColor("#ffffff", 1);
      inked(paper);
      render();
      const still = canvas.toDataURL("image/png");
      renderer.setClearColor("#000000", 0);
      inked(document.documentElement);
      render();
      return still;
    }
    function keep() {
      document.getElementById("still").src = pictured();
      document.getElementById("still").hidden = false;
    }

    function draw() {
      patches.forEach(surface);
      const only = viewed().box;
      crossed.visible = isOwn(amounts) && state === "deflected";
      outlines.forEach((one, i) => { one.visible = control("box").checked && (only === null || only === i); });
      clouds.forEach((one, i) => { one.visible = control(dots[i].group).checked; });
      if (lowest) lowest = worstCell();
      shown();
      cells();
      plot.dataset.state = state;
      redraw();
    }

    // A section shows all cells that it cuts, from the side where the eye is; without one the choice of before returns.
    let before = null;
    function cutting() {
      const cells = control("cells"), threshold = control("threshold"), now = [cells.checked, threshold.value];
      const cuts = control("axis").value !== "none";
      [cells.checked, threshold.value] = cuts ? [true, 1] : before || now;
      before = cuts ? before || now : null;
      const axis = section()[0], arm = camera.position.clone().sub(controls.target);
      if (!cuts || data.plane || Math.abs(arm.getComponent(axis)) > 0.9 * arm.length()) return;
      const aside = [0, 1, 2].filter((c) => c !== axis), size = arm.length(), side = Math.sign(arm.getComponent(axis)) || 1;
      arm.setComponent(axis, side).setComponent(aside[0], 0.35).setComponent(aside[1], 0.3);
      camera.position.copy(controls.target).add(arm.setLength(size));
      controls.update();
    }

    // The camera looks from above and behind, at what a view names: its patches fill most of the frame.
    function first() {
      if (lowest) worst();
      const { low, high, patches: names } = viewed(), inView = patches.filter((one) => names.includes(one.own));
      const places = inView.length ? inView.flatMap((one) => [one.points, one.aimed]) : [single([...low, ...high])];
      const ends = (pick, from) => [0, 1, 2].map((c) => places.reduce((found, points) => {
        for (let i = c; i < points.length; i += 3) found = pick(found, points[i]);
        return found;
      }, from));
      const [least, most] = [ends(Math.min, Infinity), ends(Math.max, -Infinity)], size = Math.hypot(...most.map((one, c) => one - least[c])) || 1;
      const middle = new THREE.Vector3(...least.map((one, c) => (one + most[c]) / 2));
      const side = least[1] + most[1] > 2 * data.middle + 1e-3 * (most[1] - least[1]) ? -1 : 1;
      camera.position.copy(middle).add(new THREE.Vector3(...(data.plane ? [0, 0, 1] : [1.1, -0.9 * side, 0.75])).setLength(4 * size));
      controls.target.copy(middle);
      const whole = data.views[data.views.length - 1], far = 20 * Math.max(size, Math.hypot(...whole.high.map((one, c) => one - whole.low[c])));
      Object.assign(camera, { near: -far, far, zoom: 1 });
      camera.lookAt(middle);
      camera.updateMatrixWorld();
      const seen = [Infinity, -Infinity, Infinity, -Infinity], point = new THREE.Vector3();
      const each = (x, y, z) => {
        point.set(x, y, z).applyMatrix4(camera.matrixWorldInverse);
        seen[0] = Math.min(seen[0], point.x); seen[1] = Math.max(seen[1], point.x);
        seen[2] = Math.min(seen[2], point.y); seen[3] = Math.max(seen[3], point.y);
      };
      if (inView.length) places.forEach((points) => { for (let i = 0; i < points.length; i += 3) each(points[i], points[i + 1], points[i + 2]); });
      else for (let i = 0; i < 8; i += 1) each(...[0, 1, 2].map((c) => (i >> c & 1 ? most : least)[c]));
      const shift = new THREE.Vector3((seen[0] + seen[1]) / 2, (seen[2] + seen[3]) / 2, 0).applyQuaternion(camera.quaternion);
      camera.position.add(shift);
      controls.target.add(shift);
      const room = inView.length ? 1.3 : 1.08; // for labels
      plot.half = [room * (seen[1] - seen[0]) / 2, room * (seen[3] - seen[2]) / 2];
      sized();
      controls.update();
    }
    function sized() {
      const ratio = plot.clientWidth / plot.clientHeight, half = Math.max(plot.half[1], plot.half[0] / ratio);
      Object.assign(camera, { left: -half * ratio, right: half * ratio, top: half, bottom: -half });
      camera.updateProjectionMatrix();
      renderer.setSize(plot.clientWidth, plot.clientHeight);
      redraw();
    }

    const STEP = Math.PI / 18;
    const TURNS = { left: [-STEP, 0, 1], right: [STEP, 0, 1], up: [0, STEP, 1], down: [0, -STEP, 1], closer: [0, 0, 1.15], farther: [0, 0, 1 / 1.15] };
    const KEYS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "closer", "=": "closer", "-": "farther", Home: "first" };
    function turn(name) {
      if (name === "save") return save();
      if (name === "first") return first();
      const [about, upwards, factor] = TURNS[name], arm = camera.position.clone().sub(controls.target), size = arm.length();
      const azimuth = Math.atan2(arm.y, arm.x) + about;
      const height = Math.min(1.5, Math.max(-1.5, Math.asin(arm.z / size) + upwards)), level = size * Math.cos(height);
      if (!data.plane && (about || upwards)) {
        camera.position.set(level * Math.cos(azimuth), level * Math.sin(azimuth), size * Math.sin(height)).add(controls.target);
      }
      camera.zoom *= factor;
      camera.updateProjectionMatrix();
      controls.update();
      return redraw();
    }
    function save() {
      const link = document.createElement("a");
      link.href = pictured();
      link.download = "sdm-deflect.png";
      link.click();
    }

    // A click names the patch and the node; two clicks make a hinge, in the mesh's own unit.
    const ends = [];
    function picked(event) {
      const frame = canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
      const place = new THREE.Vector2(2 * (event.clientX - frame.left) / frame.width - 1, 1 - 2 * (event.clientY - frame.top) / frame.height);
      ray.setFromCamera(place, camera);
      const hit = ray.intersectObjects(patches.map((one) => one.mesh).filter((one) => one.visible), false).find((one) => (
        one.object.material.clippingPlanes.every((plane) => plane.distanceToPoint(one.point) >= 0)));
      if (!hit) return;
      const { patch } = hit.object, points = at(patch), node = [hit.face.a, hit.face.b, hit.face.c].reduce((best, one) => {
        const off = (i) => Math.hypot(...hit.point.toArray().map((value, c) => value - points[3 * i + c]));
        return off(one) < off(best) ? one : best;
      });
      const own = Array.from(patch.points.subarray(3 * node, 3 * node + 3), (value) => Number((value / data.factor).toPrecision(6)));
      if (ends.length > 1) ends.splice(0);
      ends.push({ place: Array.from(patch.points.subarray(3 * node, 3 * node + 3)), text: own.join(","), patch: patch.own });
      control("picked").textContent = `${patch.own}, undeflected node at ${own.join(",")}${ends.length > 1 ? "" : "; click a second node"}`;
      hingeTold();
      choose(ends.length > 1 ? ends[0].patch : patch.own);
    }
    function choose(name) {
      chosen = boxes.length ? "" : name;
      patches.forEach(surface);
      redraw();
    }
    // The command that turns the patch of the first click about the hinge; a report has one of its own.
    const words = (name) => (/^[\w.+-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`);
    const hinge = () => `--hinge ${ends.map((one) => one.text).join(" ")}`;
    function hingeTold() {
      const whole = ends.length > 1, command = control("hinge-command"), beside = data.beside[whole ? ends[0].patch : ""] || [];
      command.hidden = control("copy-hinge").hidden = !whole;
      if (whole) {
        command.textContent = boxes.length ? hinge() : [`sdm deflect ${data.source} --surface ${words(ends[0].patch)}`,
          ...beside.map((name) => `--fixed ${words(name)}`), hinge(), `--angle 10${beside.length ? " --motion blended" : ""}`].join(" \\\n  ");
      }
      control("picked").closest("details").open = true;
    }
    function proposed({ patch, text, ends: places }) {
      ends.splice(0, ends.length, ...places.map((place, i) => ({ place: place.map((value) => data.factor * value), text: text.split(" ")[i] || text, patch })));
      if (text.split(" ").length < 2) ends.splice(1);
      control("picked").textContent = `${patch}: the line at which its skin goes on`;
      hingeTold();
      choose(patch);
    }
    // Points and line of the hinge, and an arrow that turns as a positive angle does, to the scale of the hinge.
    function hinged(layer) {
      const group = element("g", { class: "picked" }), places = ends.map((one) => one.place), seen = places.map(onScreen);
      layer.append(group);
      if (seen.length > 1) {
        const axis = new THREE.Vector3(...places[1]).sub(new THREE.Vector3(...places[0])), middle = new THREE.Vector3(...places[0]).addScaledVector(axis, 0.5);
        const radius = 0.15 * axis.length(), arm = new THREE.Vector3(1, 0, 0).cross(axis).length() > 1e-3 * axis.length() ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 0, 1);
        axis.normalize();
        arm.addScaledVector(axis, -arm.dot(axis)).setLength(radius);
        const other = axis.clone().cross(arm), turnedBy = (degrees, share = 1) => onScreen(middle.clone().addScaledVector(arm, share * Math.cos(RADIANS * degrees)).addScaledVector(other, share * Math.sin(RADIANS * degrees)).toArray());
        const path = (points) => `M${points.map((point) => point.map((value) => value.toFixed(1)).join(" ")).join("L")}`;
        group.append(element("line", { x1: seen[0][0], y1: seen[0][1], x2: seen[1][0], y2: seen[1][1] }),
          element("path", { d: path(Array.from({ length: 28 }, (_, i) => turnedBy(10 * i))) }),
          element("path", { d: path([turnedBy(252, 0.75), turnedBy(270), turnedBy(252, 1.25)]) }),
          element("text", { x: turnedBy(0)[0] + 8, y: turnedBy(0)[1] }, "a positive angle turns so"));
      }
      seen.forEach(([cx, cy], i) => group.append(element("circle", { class: "dot", cx, cy, r: 5 }), element("text", { x: cx - 9, y: cy - 8, "text-anchor": "end" }, String(i + 1))));
    }

    // The cell of lowest quality: where it is, its size, and how good it was before.
    let lowest = null;
    function worstCell() {
      let least = [Infinity];
      for (const group of groups) group.quality[state].forEach((value, cell) => { if (value < least[0]) least = [value, group, cell]; });
      if (!least[1]) return null;
      const [value, group, cell] = least, points = at(group), corners = new Set(), triangles = [];
      for (let row = 0; row < group.faces.length / group.corners; row += 1) {
        if ((group.cell ? group.cell[row] : row) !== cell) continue;
        for (let k = 0; k < group.corners; k += 1) corners.add(group.faces[row * group.corners + k]);
        for (const k of group.table) triangles.push(...points.subarray(3 * group.faces[row * group.corners + k], 3 * group.faces[row * group.corners + k] + 3));
      }
      const middle = [0, 1, 2].map((c) => Array.from(corners).reduce((sum, node) => sum + points[3 * node + c], 0) / corners.size);
      const size = Math.max(...Array.from(corners, (node) => Math.hypot(...middle.map((one, c) => points[3 * node + c] - one))));
      let near = [Infinity, null];
      for (const patch of patches) {
        const places = at(patch);
        for (let i = 0; i < places.length; i += 3) {
          const off = Math.hypot(places[i] - middle[0], places[i + 1] - middle[1], places[i + 2] - middle[2]);
          if (off < near[0]) near = [off, patch.own];
        }
      }
      const place = near[0] <= 1.0001 * size ? `on ${near[1]}` : `${(near[0] / size).toFixed(0)} cells from ${near[1]}`;
      const own = middle.map((one) => Number((one / data.factor).toPrecision(4))).slice(0, data.plane ? 2 : 3).join(", ");
      return { middle, size, triangles, lines: [`worst cell: ${value.toFixed(3)}; ${group.quality.undeflected[cell].toFixed(3)} before`, `${group.shape} ${near[1] ? place : ""}`, `at ${own}`] };
    }
    function shown() {
      shard.visible = Boolean(lowest);
      if (lowest) shard.geometry.setAttribute("position", positions(single(lowest.triangles)));
    }
    function ringed(layer) {
      const [x, y] = onScreen(lowest.middle), radius = Math.max(20, 1.4 * lowest.size * camera.zoom * plot.clientWidth / (camera.right - camera.left));
      const left = x > 0.55 * plot.clientWidth, group = element("g", { class: "worst" });
      group.append(element("circle", { class: "ring", cx: x, cy: y, r: radius }));
      lowest.lines.forEach((text, i) => group.append(element("text", { x: left ? x - radius - 8 : x + radius + 8, y: y + LINE * i - 2, "text-anchor": left ? "end" : "start" }, text)));
      layer.append(group);
    }
    // Come so close to the worst cell that it is seen, with what is around it; once more, and back to the first view.
    function worst() {
      const back = Boolean(lowest);
      lowest = back ? null : worstCell();
      control("worst").setAttribute("aria-pressed", String(Boolean(lowest)));
      if (back) { first(); return draw(); }
      if (!lowest) return;
      const arm = camera.position.clone().sub(controls.target);
      controls.target.set(...lowest.middle);
      camera.position.copy(controls.target).add(arm);
      camera.zoom = Math.min(plot.half[1], plot.half[0]) / Math.max(9 * lowest.size, 0.03 * Math.min(...plot.half));
      camera.updateProjectionMatrix();
      controls.update();
      draw();
    }

    // The verdict on the mesh that is seen, and its least quality. The page's head has that on the mesh of the run.
    const SIGNS = { passed: "\u2713", usable: "!", FAILED: "\u2717" };
    function judge(grade, words) {
      const chip = control("verdict"), least = control("least");
      if (!chip) return;
      chip.hidden = !words;
      chip.textContent = words ? `${SIGNS[grade] || ""} ${words}`.trim() : "";
      for (const one of [chip, least]) for (const name of Object.keys(SIGNS)) one.classList.toggle(name, name === grade);
      const [now, before] = [leastOf("deflected"), leastOf("undeflected")];
      least.textContent = Number.isFinite(now) ? now.toFixed(3).replace("-", "\u2212") : "";
      control("least-before").textContent = Number.isFinite(now) ? `least quality of a cell; ${before.toFixed(3).replace("-", "\u2212")} before` : "";
    }
    const leastOf = (name) => groups.reduce((found, group) => group.quality[name].reduce((one, value) => Math.min(one, value), found), Infinity);

    // Sliders: each surface has one; the others stay where they are.
    const sliders = (() => {
      let active = 0, playing = 0, direction = 1;
      const text = (amount) => String(Number(amount.toPrecision(4)));
      const percent = (share) => String(share < 1 ? Math.floor(100 * share) : Math.ceil(100 * share)); // 99.6 % is below 100
      const slider = (i) => control(`amount-${turned[i].name}`), typed = (i) => control(`typed-${turned[i].name}`);

      function to(wanted) {
        const since = performance.now();
        amounts = wanted.map((one, i) => Math.min(turned[i].range[1], Math.max(turned[i].range[0], one)));
        for (const part of [...moving, ...groups]) {
          if (!part.turns && !part.rest) continue;
          part.exact.deflected = placed(part, amounts);
          part.moved = single(part.exact.deflected);
          if (part.quality) part.quality.deflected = judged(part, "deflected", amounts);
        }
        if (state === "undeflected") control("deflected").checked = true;
        state = state === "interpolated" && isOwn(amounts) ? state : "deflected";
        draw();
        told();
        const milliseconds = performance.now() - since;
        Object.assign(plot.dataset, { amounts: JSON.stringify(Object.fromEntries(turned.map((one, i) => [one.name, amounts[i]]))), milliseconds });
        return milliseconds;
      }

      // What was measured around an amount: only of a surface alone, with the others where they stood.
      function told() {
        turned.forEach((one, i) => {
          slider(i).value = amounts[i];
          if (document.activeElement !== typed(i)) typed(i).value = text(amounts[i]);
        });
        const one = turned[active], away = turned.filter((_, i) => i !== active && amounts[i] !== data.turn.stands[i]);
        const [k, share] = around(one.measured, amounts[active]), two = [one.measured[k], one.measured[k + 1]];
        const near = share === 0 ? two.slice(0, 1) : share === 1 ? two.slice(1) : two;
        const failed = [...new Set(near.flatMap((row) => row.failed))];
        const told = near.flatMap((row) => row.reservations.map((text) => (near.length > 1 ? `${text} at ${signed(row.amount, one.unit)}` : text)));
        const inverted = Math.max(...near.map((row) => row.inverted)), off = Math.max(...near.map((row) => row.site_error)) > one.tolerance;
        const place = near.length > 1 ? `Measured at ${signed(two[0].amount, one.unit)} and ${signed(two[1].amount, one.unit)}` : "Measured here";
        const grade = failed.length ? "FAILED" : told.length ? "usable" : "passed";
        const words = { FAILED: `FAILED: ${failed.join(", ")}`, usable: `usable, with ${told.join(" and ")}`, passed: "all validations passed" }[grade];
        control("measured").textContent = away.length
          ? `Checks are known for one surface at a time; here ${away.length + 1} are moved. Least quality: of this mesh.`
          : `${place}: ${inverted ? `${inverted} cells are` : "no cell is"} inside out, ${off ? "not fitted" : "fitted"} within the tolerance.`;
        if (isOwn(amounts)) judge(data.grade, "");
        else judge(...(away.length ? ["", "checks not measured here"] : [grade, words]));
        const wanted = turned.map((each, i) => `${each.name}=${Number(amounts[i].toPrecision(12))}`).join(",");
        control("command").textContent = data.turn.command.replace("AMOUNTS", turned.length > 1 ? wanted : wanted.slice(wanted.lastIndexOf("=") + 1));
        const [low, high] = one.range, x = LEFT + (amounts[active] - low) / (high - low) * (RIGHT - LEFT);
        for (const mark of control("curve").querySelectorAll(".here")) mark.setAttribute("transform", `translate(${x.toFixed(1)} 0)`);
      }

      // Two curves over the range of a surface, one below the other: the least quality, and the error at the sites.
      const [LEFT, RIGHT, TOP, LOW] = [46, 276, 22, 92];
      function curve() {
        const one = turned[active], [low, high] = one.range, rows = one.measured, x = (amount) => LEFT + (RIGHT - LEFT) * (amount - low) / (high - low);
        const passed = one.passed ? `<rect class="passed" x="${x(one.passed[0])}" y="${TOP}" width="${x(one.passed[1]) - x(one.passed[0])}" height="${LOW - TOP}"/>` : "";
        const panel = (name, values, floor, top, ticks, limit, more = "") => {
          const y = (value) => LOW - (LOW - TOP) * Math.max(0, Math.min(1, (value - floor) / (top - floor)));
          const line = values.map(([amount, value]) => `${x(amount).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
          return `<svg viewBox="0 0 288 124" role="img"><title></title>${passed}<path class="axes" d="M${LEFT} ${TOP}V${LOW}H${RIGHT}"/><text x="0" y="12">${name}</text>
            ${[floor, top].map((value) => `<text x="${LEFT - 6}" y="${y(value) + 4}" text-anchor="end">${ticks(value)}</text>`).join("")}
            ${limit === null ? "" : `<path class="limit" d="M${LEFT} ${y(limit)}H${RIGHT}"/>`}
            <text x="${LEFT}" y="${LOW + 16}" text-anchor="middle">${signed(low, one.unit === "deg" ? "deg" : "").trim()}</text><text x="${RIGHT}" y="${LOW + 16}" text-anchor="end">${signed(high, one.unit === "deg" ? "deg" : "").trim()}</text>
            <polyline points="${line}"/>${more}<path class="here" d="M0 ${TOP - 4}V${LOW + 4}"/></svg>`;
        };
        const quality = rows.filter((row) => row.least !== null).map((row) => [row.amount, row.least]);
        const best = Math.ceil(10 * Math.max(0.1, ...quality.map(([, value]) => value))) / 10, bad = Math.floor(10 * Math.min(0, ...quality.map(([, value]) => value))) / 10;
        const inverted = rows.filter((row) => row.inverted).map((row) => `<text x="${x(row.amount)}" y="${TOP + 12}" text-anchor="middle">${row.inverted} inverted</text>`).join("");
        const errors = rows.map((row) => [row.amount, 100 * row.site_error / one.tolerance]), most = Math.max(100, ...errors.map(([, value]) => value));
        control("curve").innerHTML = panel("least quality of a cell", quality, bad, best, (value) => value.toFixed(1), null, inverted)
          + panel("error at the sites, % of the tolerance", errors, 0, Math.ceil(most / 20) * 20, (value) => value.toFixed(0), 100);
        const [first, second] = control("curve").querySelectorAll("title");
        first.textContent = `Least quality of ${one.name} over its amount: ${quality.map(([amount, value]) => `${value.toFixed(3)} at ${text(amount)}`).join(", ") || "no cells"}`;
        second.textContent = `Error at the data sites of ${one.name} over its amount: ${errors.map(([amount, value]) => `${value.toFixed(0)} % at ${text(amount)}`).join(", ")}`;
        control("curve-name").textContent = `${one.name}, ${signed(low, one.unit)} to ${signed(high, one.unit)}`;
      }

      function moved(i, amount) {
        const other = active !== i;
        active = i;
        if (other) curve();
        to(amounts.map((old, k) => (k === i ? amount : old)));
      }

      // An amount that is typed; what cannot be is said beside it, and the mesh stays.
      function read(i) {
        const given = typed(i).value.trim(), amount = Number(given.replace("\u2212", "-").replace(",", ".") || NaN), [low, high] = turned[i].range;
        const outside = amount < low || amount > high, range = `${signed(low, "").trim()} to ${signed(high, "").trim()}`;
        control(`wrong-${turned[i].name}`).textContent = Number.isFinite(amount)
          ? outside ? `${text(amount)} is outside ${range}` : "" : `\u201c${given}\u201d is no number`;
        if (Number.isFinite(amount) && !outside) moved(i, amount);
      }

      function stepped() {
        const [low, high] = turned[active].range, next = amounts[active] + direction * (high - low) / 60;
        if (next >= high || next <= low) direction = -direction;
        to(amounts.map((old, k) => (k === active ? next : old)));
        playing = requestAnimationFrame(stepped);
      }
      function play() {
        if (playing) cancelAnimationFrame(playing);
        playing = playing ? 0 : requestAnimationFrame(stepped);
        control("play").textContent = playing ? "Stop" : "Play";
      }

      function offered() {
        turned.forEach((one, i) => {
          slider(i).addEventListener("input", () => { control(`wrong-${one.name}`).textContent = ""; moved(i, Number(slider(i).value)); });
          typed(i).addEventListener("change", () => read(i));
        });
        control("play").addEventListener("click", play);
        control("own").addEventListener("click", () => to(own));
        control("copy").addEventListener("click", () => navigator.clipboard.writeText(control("command").textContent).catch(() => {}));
        plot.sdm = {
          at(wanted) {
            const milliseconds = to(turned.map((one, i) => wanted[one.name] ?? amounts[i]));
            return {
              patches: Object.fromEntries(patches.map((one) => [one.name, one.exact.deflected.map((value) => value / data.factor)])),
              cells: groups.map(({ shape, rows, quality }) => ({ shape, rows, quality: quality.deflected })), milliseconds,
            };
          },
        };
        curve();
        to(own);
      }
      return { to, offered };
    })();

    function offered() {
      let pressed = [0, 0];
      canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
      canvas.addEventListener("pointerup", (event) => {
        if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4) picked(event);
      });
      plot.addEventListener("keydown", (event) => {
        if (!KEYS[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
        event.preventDefault();
        turn(KEYS[event.key]);
      });
      for (const button of document.querySelectorAll("#scene-turns button")) {
        button.addEventListener("click", () => turn(button.dataset.turn));
      }
      data.views.forEach((view, i) => control("view").add(new Option(`view: ${view.name}`, String(i))));
      control("view").addEventListener("change", first);
      for (const name of ["view", "lines", "overlay", "box", "sites", "centres", "cells", "colour", "axis"]) {
        control(name).addEventListener("change", () => {
          if (name === "axis") cutting();
          if (coloured() === "change" && name === "colour") control("cells").checked = true;
          draw();
        });
      }
      control("threshold").addEventListener("input", () => { control("cells").checked = true; draw(); });
      control("place").addEventListener("input", () => { if (control("axis").value !== "none") draw(); });
      control("worst").addEventListener("click", worst);
      control("copy-hinge").addEventListener("click", () => navigator.clipboard.writeText(control("hinge-command").textContent).catch(() => {}));
      for (const button of document.querySelectorAll("[data-hinge]")) button.addEventListener("click", () => proposed(data.hinges[button.dataset.hinge]));
      for (const one of document.querySelectorAll("input[name=state]")) {
        one.addEventListener("change", () => {
          state = one.id.slice("scene-".length);
          if (state === "interpolated") sliders.to(own); // the run alone has a mesh before its repair
          draw();
        });
      }
      for (const patch of patches) {
        const label = document.createElement("label"), box = document.createElement("input"), colour = document.createElement("i");
        box.type = "checkbox";
        box.checked = shownPatches.has(patch.name);
        colour.style.background = `var(--${patch.surface ? "moves" : "stays"})`;
        box.addEventListener("change", () => { shownPatches[box.checked ? "add" : "delete"](patch.name); draw(); });
        label.append(box, colour, patch.name);
        label.addEventListener("pointerenter", () => { if (!boxes.length) choose(patch.own); });
        control("patches").append(label);
      }
      controls.addEventListener("change", redraw);
      new ResizeObserver(() => { if (plot.clientWidth) sized(); }).observe(plot);
    }

    // Poor cells are those somewhat better than the worst: so few that one sees where they are.
    if (groups.length) control("threshold").value = Math.min(0.3, Math.max(0.1, 1.5 * leastOf("deflected")));
    control("cells").checked = Boolean(data.grade) && data.grade !== "passed";
    offered();
    first();
    inked(document.documentElement);
    draw();
    if (turned.length) sliders.offered();
    else judge(data.grade, "");
  }

  // The page's policy allows the library because it knows its digest: nothing else runs.
  async function library() {
    const script = document.createElement("script");
    script.textContent = await (await inflated("scene-library")).text();
    document.head.append(script);
  }

  library().then(drawn).catch((error) => without(String(error)));
})();
