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
    for (const name of ["controls", "turns"]) control(name).hidden = true;
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
    let amounts = own.slice();
    function segments(points, pairs, colour) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", points);
      if (pairs) geometry.setIndex(new THREE.BufferAttribute(pairs, 1));
      const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour, clippingPlanes: [] }));
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
      patch.wire = segments(shared, patch.edges, "#222222");
      const goes = new Set(patch.modes.flatMap((mode) => Array.from(mode.at)));
      const off = (i) => goes.has(i) || [0, 1, 2].some((c) => patch.points[3 * i + c] !== patch.moved[3 * i + c]);
      patch.outline = segments(positions(patch.points), patch.edges.filter((_, i) => off(patch.edges[i - i % 2]) || off(patch.edges[i - i % 2 + 1])), "#0072b2");
    }
    for (const group of groups) {
      group.mesh = solid();
      if (data.plane) group.wire = segments(positions(single(group.moved)), edges(group), "#888888");
    }
    const arrows = solid(); // which way the surfaces moved
    arrows.geometry.setAttribute("position", positions(lengthsOf(data.arrows.segments)));
    arrows.material.color.set("#e69f00");
    const outlines = boxes.map((points, i) => segments(positions(points), null, data.boxes[i].colour));
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

    // Lines of a plane mesh are in the colour of the page's text, those that move in red.
    const scheme = matchMedia("(prefers-color-scheme: dark)"), written = () => (scheme.matches ? "#e4e6e9" : "#222222");
    let ink = written();
    function inked(colour) {
      ink = colour;
      patches.forEach(surface);
    }
    scheme.addEventListener("change", () => { inked(written()); redraw(); });

    function surface(patch) {
      const view = viewed(), visible = shownPatches.has(patch.name) && (!view.near || view.near.includes(patch.own));
      const shared = patch.mesh.geometry.getAttribute("position"), shaded = coloured() === "displacement";
      const cut = section()[0] < 0 ? [] : [knife];
      if (patch.drawn !== at(patch)) {
        patch.drawn = at(patch);
        shared.array.set(patch.drawn);
        shared.needsUpdate = true;
      }
      for (const one of [patch.mesh, patch.wire]) one.material.clippingPlanes = cut;
      patch.wire.material.color.set(!data.plane ? "#222222" : patch.surface ? patch.colour : ink);
      if (shaded) patch.mesh.geometry.setAttribute("color", shades(distances(patch, at(patch)), data.colours.displacement, [0, farthest()]));
      patch.mesh.material.vertexColors = shaded;
      patch.mesh.material.color.set(shaded ? "#ffffff" : patch.colour);
      patch.mesh.material.needsUpdate = true;
      patch.mesh.visible = visible;
      patch.wire.visible = visible && control("lines").checked;
      patch.outline.visible = visible && (patch.goes || patch.turns) && control("overlay").checked && state !== "undeflected";
    }

    // Fill the triangles around the cells of a group that are below the threshold and in the section.
    function outside(group, threshold, change, table, [low, high]) {
      const values = group.quality[state], before = group.quality.undeflected, points = at(group), cut = cutter(group);
      const rows = group.faces.length / group.corners, most = rows * group.table.length;
      if (!group.mesh.geometry.getAttribute("position")) {
        for (const name of ["position", "color"]) group.mesh.geometry.setAttribute(name, positions(new Float32Array(3 * most)));
      }
      const [place, shade] = ["position", "color"].map((name) => group.mesh.geometry.getAttribute(name));
      let filled = 0;
      for (let row = 0; row < rows; row += 1) {
        const cell = group.cell ? group.cell[row] : row, first = row * group.corners;
        if (values[cell] >= threshold || !cut(first, group.corners)) continue;
        const value = change ? values[cell] - before[cell] : values[cell];
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
        group.wire.material.color.set(ink);
      }
      const [scale, range] = change ? [data.colours.change, data.colours.changes] : [data.colours.shades, data.colours.range];
      for (const group of groups) {
        group.mesh.visible = control("cells").checked && count > 0;
        group.mesh.material.vertexColors = true;
        if (group.mesh.visible) outside(group, threshold, change, colours(scale), range);
      }
      control("bar").hidden = true;
      if (coloured() === "displacement") bar("displacement, " + data.unit, data.colours.displacement, [0, farthest()]);
      else if (control("cells").checked && count) bar(change ? "change of " + data.measure : data.measure, scale, range);
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
      renderer.setViewport(8, 8, 84, 84);
      renderer.clearDepth();
      renderer.render(cross, corner);
      const length = 200 * (camera.right - camera.left) / camera.zoom / wide, power = 10 ** Math.floor(Math.log10(length));
      const round = [1, 2, 5].map((one) => one * power).filter((one) => one <= length).pop();
      control("bar-of-scale").style.width = `${200 * round / length}px`;
      control("text").textContent = `${round.toPrecision(1) * 1} ${data.unit}`;
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
      inked("#222222");
      render();
      const still = canvas.toDataURL("image/png");
      renderer.setClearColor("#000000", 0);
      inked(written());
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
      arrows.visible = isOwn(amounts) && control("overlay").checked && state !== "undeflected";
      outlines.forEach((one, i) => { one.visible = control("box").checked && (only === null || only === i); });
      clouds.forEach((one, i) => { one.visible = control(dots[i].group).checked; });
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

    // What the first view holds: the moving surfaces of it at half the width, or everything.
    function framed() {
      const view = viewed(), parts = view.near ? moving.filter((one) => one.surface && view.near.includes(one.own)) : [];
      if (!parts.length) return view;
      const ends = (pick) => [0, 1, 2].map((c) => parts.reduce((found, one) => one.aimed.reduce(
        (each, value, i) => (i % 3 === c ? pick(each, value) : each), found), pick === Math.min ? Infinity : -Infinity));
      const low = ends(Math.min), high = ends(Math.max);
      return { low: low.map((one, c) => 1.5 * one - 0.5 * high[c]), high: high.map((one, c) => 1.5 * one - 0.5 * low[c]) };
    }
    // The camera looks from the side to which the surfaces move.
    function first() {
      const { low, high } = framed(), middle = new THREE.Vector3(...low.map((one, c) => (one + high[c]) / 2));
      const rise = moving.reduce((sum, one) => sum + one.aimed.reduce((each, value, i) => each + (i % 3 === 2 ? value - one.points[i] : 0), 0), 0);
      const side = low[1] + high[1] > 2 * data.middle + 1e-3 * (high[1] - low[1]) ? -1 : 1;
      const from = data.plane ? [0, 0, 1] : [1.1, -0.9 * side, rise < 0 ? -0.75 : 0.75];
      const size = Math.hypot(...high.map((one, c) => one - low[c]));
      camera.position.copy(middle).add(new THREE.Vector3(...from).setLength(4 * size));
      controls.target.copy(middle);
      Object.assign(camera, { near: -20 * size, far: 20 * size, zoom: 1 });
      camera.lookAt(middle);
      camera.updateMatrixWorld();
      let [wide, tall] = [0, 0];
      for (let i = 0; i < 8; i += 1) {
        const corner = new THREE.Vector3(...[0, 1, 2].map((c) => (i >> c & 1 ? high : low)[c])).applyMatrix4(camera.matrixWorldInverse);
        [wide, tall] = [Math.max(wide, Math.abs(corner.x)), Math.max(tall, Math.abs(corner.y))];
      }
      plot.half = [wide, tall];
      sized();
      controls.update();
    }
    function sized() {
      const ratio = plot.clientWidth / plot.clientHeight, half = 1.05 * Math.max(plot.half[1], plot.half[0] / ratio);
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
      ends.push((data.plane ? own.slice(0, 2) : own).join(","));
      const hinge = ends.length > 1 && !data.plane ? `; --hinge ${ends.slice(-2).join(" ")}` : "";
      control("picked").textContent = `${patch.own}, undeflected node at ${ends[ends.length - 1]}${hinge}`;
    }

    // Put the section through the cell of lowest quality.
    function worst() {
      let least = [Infinity];
      for (const group of groups) group.quality[state].forEach((value, cell) => { if (value < least[0]) least = [value, group, cell]; });
      if (!least[1]) return;
      if (control("axis").value === "none") control("axis").value = "y";
      const [, group, cell] = least, axis = section()[0], points = at(group), found = [];
      for (let row = 0; row < group.faces.length / group.corners; row += 1) {
        if ((group.cell ? group.cell[row] : row) !== cell) continue;
        for (let k = 0; k < group.corners; k += 1) found.push(points[3 * group.faces[row * group.corners + k] + axis]);
      }
      const place = (Math.min(...found) + Math.max(...found)) / 2;
      if (place < viewed().low[axis] || place > viewed().high[axis]) control("view").value = String(data.views.length - 1);
      control("place").value = String(100 * (place - viewed().low[axis]) / (viewed().high[axis] - viewed().low[axis]));
      cutting();
      draw();
    }

    // Sliders: each surface has one; the others stay where they are.
    const sliders = (() => {
      let active = 0, playing = 0, direction = 1;
      const text = (amount) => String(Number(amount.toPrecision(4)));
      const unit = (one) => (one.unit === "deg" ? "\u00b0" : ` ${one.unit}`);
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
        const near = share === 0 ? two.slice(0, 1) : share === 1 ? two.slice(1) : two, failed = [...new Set(near.flatMap((row) => row.failed))];
        const least = near.map((row) => row.least).filter((value) => value !== null);
        const worst = (name) => Math.max(...near.map((row) => row[name])), inverted = worst("inverted");
        const said = away.length ? `not measured: ${away.map((other) => other.name).join(", ")} moved as well` : [
          `measured ${near.length > 1 ? `at ${text(two[0].amount)} and ${text(two[1].amount)}` : "here"}`,
          failed.length ? `failed ${failed.join(", ")}` : "all checks passed",
          ...(least.length ? [`least quality ${Math.min(...least).toFixed(3)}`] : []),
          inverted ? `${inverted} newly inverted cells` : "no newly inverted cell",
          `error at the sites ${(100 * worst("site_error") / one.tolerance).toFixed(0)} % of the tolerance`,
        ].join(", ");
        control("measured").textContent = `${one.name} at ${text(amounts[active])}${unit(one)}: ${said}.`;
        control("measured").classList.toggle("bad", !away.length && failed.length > 0);
        const wanted = turned.map((each, i) => `${each.name}=${Number(amounts[i].toPrecision(12))}`).join(",");
        control("command").textContent = data.turn.command.replace("AMOUNTS", turned.length > 1 ? wanted : wanted.slice(wanted.lastIndexOf("=") + 1));
        const mark = control("curve").querySelector(".here"), [low, high] = one.range;
        if (mark) mark.setAttribute("transform", `translate(${(40 + 540 * (amounts[active] - low) / (high - low)).toFixed(1)} 0)`);
      }

      // The least quality, the inverted cells and the error at the sites over the range of a surface.
      function curve() {
        const one = turned[active], [low, high] = one.range, rows = one.measured;
        const x = (amount) => 40 + 540 * (amount - low) / (high - low), y = (share) => 110 - 96 * Math.max(0, Math.min(1, share));
        const line = (values, name) => `<polyline class="${name}" points="${values.map(([amount, share]) => `${x(amount).toFixed(1)},${y(share).toFixed(1)}`).join(" ")}"/>`;
        const quality = rows.filter((row) => row.least !== null).map((row) => [row.amount, row.least]);
        const values = quality.map(([, value]) => value), top = Math.ceil(10 * Math.max(1e-3, ...values)) / 10, floor = Math.floor(10 * Math.min(0, ...values)) / 10;
        const passed = one.passed ? `<rect class="passed" x="${x(one.passed[0])}" y="14" width="${x(one.passed[1]) - x(one.passed[0])}" height="96"/>` : "";
        const bad = rows.filter((row) => row.inverted).map((row) => `<text x="${x(row.amount)}" y="124" text-anchor="middle">${row.inverted} inverted</text>`);
        control("curve").innerHTML = `<svg viewBox="0 0 620 150" role="img"><title></title>${passed}<path class="axes" d="M40 14V110H580"/>
          <text x="34" y="18" text-anchor="end">${top.toFixed(1)}</text><text x="34" y="113" text-anchor="end">${floor ? floor.toFixed(1) : 0}</text>
          <text x="40" y="140" text-anchor="middle">${text(low)}</text><text x="580" y="140" text-anchor="middle">${text(high)}</text>
          ${line(quality.map(([amount, value]) => [amount, (value - floor) / (top - floor)]), "quality")}${line(rows.map((row) => [row.amount, row.site_error / one.tolerance]), "error")}
          ${bad.join("")}<g class="here"><path d="M0 8V116"/></g></svg>`;
        const ends = quality.map(([amount, value]) => `${value.toFixed(3)} at ${text(amount)}`).join(", ");
        control("curve").querySelector("title").textContent = `Least quality of ${one.name} over its amount: ${ends || "no cells"}`;
        control("curve-name").textContent = `${one.name}, ${text(low)} to ${text(high)}${unit(one)}`;
      }

      function moved(i, amount) {
        if (!Number.isFinite(amount)) return told();
        const other = active !== i;
        active = i;
        if (other) curve();
        to(amounts.map((old, k) => (k === i ? amount : old)));
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
        control("play").textContent = playing ? "stop" : "play";
      }

      function offered() {
        turned.forEach((one, i) => {
          slider(i).addEventListener("input", () => moved(i, Number(slider(i).value)));
          typed(i).addEventListener("change", () => moved(i, Number(typed(i).value.replace("\u2212", "-").replace(",", "."))));
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
      data.views.forEach((view, i) => control("view").add(new Option(view.name, String(i))));
      control("view").addEventListener("change", first);
      if (boxes.length > 1) control("view").value = String(data.views.length - 1);
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
        colour.style.background = patch.colour;
        box.addEventListener("change", () => { shownPatches[box.checked ? "add" : "delete"](patch.name); draw(); });
        label.append(box, colour, patch.name);
        control("patches").append(label);
      }
      controls.addEventListener("change", redraw);
      new ResizeObserver(() => { if (plot.clientWidth) sized(); }).observe(plot);
    }

    offered();
    first();
    draw();
    if (turned.length) sliders.offered();
  }

  // The page's policy allows the library because it knows its digest: nothing else runs.
  async function library() {
    const script = document.createElement("script");
    script.textContent = await (await inflated("scene-library")).text();
    document.head.append(script);
  }

  library().then(drawn).catch((error) => without(String(error)));
})();
