"use strict";
// Draws the turnable picture from the JSON in #scene-data and the arrays in #scene-arrays with plotly, which is in
// #scene-library; all three are compressed.
// All names of the data go through text() or textContent.
(async () => {
  const plot = document.getElementById("turnable");
  const control = (name) => document.getElementById("scene-" + name);
  const text = (name) => name.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0)).buffer;
  const column = (rows, width, which) => rows.filter((_, i) => i % width === which);
  const axes = (points) => ({ x: column(points, 3, 0), y: column(points, 3, 1), z: column(points, 3, 2) });

  const inflated = async (name) => {
    const packed = new Blob([bytes(document.getElementById(name).textContent)]);
    return new Response(packed.stream().pipeThrough(new DecompressionStream("gzip")));
  };

  function drawable() {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }

  function without(reason) {
    control("controls").hidden = true;
    plot.classList.add("empty");
    plot.textContent = "The turnable picture cannot be drawn: " + reason + " All else on this page is complete.";
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

  function unpacked(part) {
    const points = lengthsOf(part.points), moved = part.moved ? lengthsOf(part.moved) : points;
    return {
      ...part, points, moved, interpolated: part.interpolated ? lengthsOf(part.interpolated) : moved,
      goes: Boolean(part.moved), faces: indices(part.faces),
    };
  }

  const patches = data.patches.map(unpacked).map((patch) => (
    { ...patch, edges: patch.edges ? indices(patch.edges) : edges(patch.faces) }));
  const groups = data.cells.groups.map(unpacked).map((group) => ({
    ...group, cell: group.cell ? indices(group.cell) : null,
    quality: {
      undeflected: numbers(group.before), deflected: numbers(group.after), interpolated: numbers(group.unrepaired || group.after),
    },
  }));
  const boxes = data.boxes.map((box) => lengthsOf(box.segments));
  const dots = data.dots.map((one) => ({ ...one, points: lengthsOf(one.points) }));
  const LABELS = { beside: 60, below: 35, above: 10 }; // pixels around the axes in the first view
  let state = "deflected";

  const at = (part) => ({ undeflected: part.points, interpolated: part.interpolated, deflected: part.moved })[state];
  const lengths = (part, points) => Float32Array.from({ length: points.length / 3 }, (_, i) => (
    Math.hypot(...[0, 1, 2].map((c) => points[3 * i + c] - part.points[3 * i + c]))));
  const most = (part) => lengths(part, part.moved).reduce((sofar, one) => Math.max(sofar, one), 0);
  const farthest = Math.max(0, ...patches.filter((one) => one.goes).map(most));
  const coloured = () => control("colour").value;
  const shownPatches = new Set(patches.filter((one) => !one.hidden).map((one) => one.name));

  function edges(triangles) {
    const seen = new Map();
    for (let i = 0; i < triangles.length; i += 3) {
      for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
        const pair = [triangles[i + a], triangles[i + b]].sort((p, q) => p - q);
        seen.set(pair[0] * 4294967296 + pair[1], pair);
      }
    }
    return Array.from(seen.values()).flat();
  }

  // Pairs of nodes as broken lines: start, end, gap.
  function lines(points, pairs) {
    const xyz = [0, 1, 2].map(() => new Float32Array(1.5 * pairs.length).fill(NaN));
    pairs.forEach((node, i) => {
      const slot = 3 * (i >> 1) + (i & 1);
      xyz.forEach((axis, c) => { axis[slot] = points[3 * node + c]; });
    });
    return { x: xyz[0], y: xyz[1], z: xyz[2] };
  }

  const light = {
    lighting: { ambient: 0.85, diffuse: 0.35, specular: 0.04, roughness: 0.9, fresnel: 0 },
    lightposition: { x: 30000, y: -20000, z: 60000 }, flatshading: true,
  };
  const dark = () => window.matchMedia("(prefers-color-scheme: dark)").matches;

  function surface(patch) {
    const view = data.views[control("view").value];
    const visible = shownPatches.has(patch.name) && (!view.near || view.near.includes(patch.own));
    const common = { name: text(patch.name), showlegend: false };
    const shades = coloured() === "displacement" // one colour is a scale, too: a mesh that had one keeps its old colours else
      ? { intensity: lengths(patch, at(patch)), colorscale: data.colours.displacement, cmin: 0, cmax: farthest }
      : { intensity: new Float32Array(patch.points.length / 3), colorscale: [[0, patch.colour], [1, patch.colour]], cmin: 0, cmax: 1 };
    const mesh = {
      ...common, type: "mesh3d", ...axes(at(patch)), ...shades, ...light, visible, showscale: false,
      i: column(patch.faces, 3, 0), j: column(patch.faces, 3, 1), k: column(patch.faces, 3, 2),
      hovertemplate: "%{x:.5~g}, %{y:.5~g}, %{z:.5~g} " + text(data.unit) + "<extra>" + text(patch.name) + "</extra>",
    };
    const wire = (points, colour, shown) => ({
      ...common, type: "scatter3d", mode: "lines", ...lines(points, patch.edges), line: { color: colour, width: 1.5 },
      hoverinfo: "skip", visible: visible && shown,
    });
    const ghost = patch.goes && control("overlay").checked && state !== "undeflected";
    return [mesh, wire(at(patch), "#222222", control("lines").checked), wire(patch.points, "#0072b2", ghost)];
  }

  // A colour bar needs a trace: of displacement it is one dot that is not seen.
  const scale = () => ({
    type: "scatter3d", mode: "markers", x: [NaN], y: [NaN], z: [NaN], showlegend: false, hoverinfo: "skip",
    visible: coloured() === "displacement",
    marker: {
      size: 0.1, color: [0], colorscale: data.colours.displacement, cmin: 0, cmax: farthest, showscale: true,
      colorbar: bar("displacement, " + data.unit),
    },
  });

  const bar = (title) => ({ title: { text: text(title), side: "right" }, len: 0.55, x: 1, xanchor: "right", y: 0.35, thickness: 12 });

  function outlines() {
    const ends = (points) => Array.from({ length: points.length / 3 }, (_, i) => i);
    const only = data.views[control("view").value].box;
    return boxes.map((points, i) => ({
      type: "scatter3d", mode: "lines", ...lines(points, ends(points)), name: text("box of " + data.boxes[i].name),
      line: { color: "#cc00cc", width: 4 }, hoverinfo: "skip", showlegend: false,
      visible: control("box").checked && (only === null || only === i),
    }));
  }

  const scattered = () => dots.map((one) => ({
    type: "scatter3d", mode: "markers", ...axes(one.points), name: text(one.name + " (" + one.count + ")"), showlegend: false,
    marker: { size: 2.4, color: one.colour }, hoverinfo: "name",
    visible: control(one.group).checked,
  }));

  // Whether the plane of the section cuts a cell, by its row of nodes.
  function cutter(group) {
    const axis = "xyz".indexOf(control("axis").value), points = at(group);
    if (axis < 0) return () => true;
    const view = data.views[control("view").value], share = Number(control("place").value) / 100;
    const place = view.low[axis] + share * (view.high[axis] - view.low[axis]);
    control("where").textContent = `${"xyz"[axis]} = ${place.toPrecision(4)} ${data.unit}`;
    return (first, corners) => {
      let above = false, below = false;
      for (let i = first; i < first + corners; i += 1) {
        if (points[3 * group.faces[i] + axis] < place) below = true; else above = true;
      }
      return above && below;
    };
  }

  // The triangles around the cells of a group that are below the threshold and in the section.
  function outside(group, threshold) {
    const own = group.quality[state], before = group.quality.undeflected, i = [], j = [], k = [], intensity = [];
    const rows = group.faces.length / group.corners, cut = cutter(group), change = coloured() === "change";
    for (let row = 0; row < rows; row += 1) {
      const cell = group.cell ? group.cell[row] : row, first = row * group.corners;
      if (own[cell] >= threshold || !cut(first, group.corners)) continue;
      for (let t = 0; t < group.table.length; t += 3) {
        i.push(group.faces[first + group.table[t]]);
        j.push(group.faces[first + group.table[t + 2]]);
        k.push(group.faces[first + group.table[t + 1]]);
        intensity.push(change ? own[cell] - before[cell] : own[cell]);
      }
    }
    return { i, j, k, intensity };
  }

  function bad() {
    const threshold = Number(control("threshold").value), change = coloured() === "change";
    const measure = data.measure.length > 24 ? "quality" : data.measure;
    const values = groups.flatMap((group) => Array.from(group.quality[state]));
    const count = values.filter((value) => value < threshold).length;
    const inverted = values.filter((value) => value <= 0).length;
    control("count").textContent =
      count + " of " + data.cells.all + " cells below " + threshold.toFixed(2) + ", " + inverted + " inverted";
    if (control("axis").value === "none") control("where").textContent = "";
    const shades = change ? { colorscale: data.colours.change, cmin: data.colours.changes[0], cmax: data.colours.changes[1] }
      : { colorscale: data.colours.shades, cmin: data.colours.range[0], cmax: data.colours.range[1] };
    return groups.map((group, number) => ({
      type: "mesh3d", ...axes(at(group)), ...outside(group, threshold), intensitymode: "cell", ...light, ...shades,
      showlegend: false, showscale: number === 0 && coloured() !== "displacement",
      colorbar: bar(change ? "change of " + measure : measure),
      name: "cells", visible: control("cells").checked && count > 0,
      hovertemplate: (change ? "change " : "quality ") + "%{intensity:.3f}<extra></extra>",
    }));
  }

  // Scale of a box and where its middle is looked at from a direction, so that the picture holds it and its labels. The
  // picture is 2 units high.
  function fitted(span, towards, up) {
    const along = (a, b) => a.reduce((sum, one, c) => sum + one * b[c], 0);
    const unit = (a) => a.map((one) => one / Math.hypot(...a));
    const cross = (a, b) => [0, 1, 2].map((c) => a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3]);
    const right = unit(cross(up, towards)), upright = unit(cross(towards, right));
    const [wide, high] = [right, upright].map((axis) => along(span, axis.map(Math.abs)));
    const pixel = 2 / plot.clientHeight, room = pixel * plot.clientWidth;
    const scale = Math.min(
      (room - 2 * pixel * LABELS.beside) / wide, (2 - pixel * (LABELS.below + LABELS.above)) / high);
    const lower = pixel * (LABELS.below - LABELS.above) / 2 / along(upright, up);
    const [x, y, z] = up.map((one) => -lower * one);
    return { scale, center: { x, y, z } };
  }

  function layout() {
    const view = data.views[control("view").value], ink = dark() ? "#d8d8d8" : "#333333", grid = dark() ? "#444444" : "#dddddd";
    const span = view.high.map((high, c) => high - view.low[c]);
    const axis = (name, c) => ({
      title: { text: name + ", " + data.unit }, range: [view.low[c], view.high[c]], color: ink, gridcolor: grid, zeroline: false,
      showbackground: false, nticks: 6, showspikes: false, visible: c < 2 || !data.plane,
    });
    const side = view.low[1] + view.high[1] > 2 * data.middle + 1e-3 * span[1] ? -1 : 1;
    const from = data.plane ? [0, 0, 2] : [1.1, -0.9 * side, 0.75], upwards = data.plane ? [0, 1, 0] : [0, 0, 1];
    const { scale, center } = fitted(span, from, upwards), xyz = ([x, y, z]) => ({ x, y, z });
    const eye = xyz(from.map((one, c) => one + [center.x, center.y, center.z][c]));
    const camera = { eye, center, up: xyz(upwards), projection: { type: "orthographic" } };
    return {
      scene: {
        xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2), aspectmode: "manual",
        aspectratio: xyz(span.map((one) => scale * one)), camera, uirevision: view.name,
      },
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { family: "system-ui, sans-serif", color: ink },
      showlegend: false, uirevision: view.name, hoverlabel: { namelength: -1 },
    };
  }

  const settings = { responsive: true, displayModeBar: false, scrollZoom: true };

  function draw() {
    const traces = [...patches.flatMap(surface), ...outlines(), ...scattered(), scale(), ...bad()];
    return Plotly.react(plot, traces, layout(), settings).then(() => { plot.dataset.state = state; keep(); });
  }

  // What is printed is the picture as it was seen last, with axes for white paper.
  let pending = 0;
  function keep() {
    clearTimeout(pending);
    pending = setTimeout(() => {
      const still = document.getElementById("still"), { _scene: scene } = plot._fullLayout.scene;
      const { tickColor, labelColor, gridColor } = scene.axesOptions, ink = Array(3).fill([0.2, 0.2, 0.2, 1]);
      Object.assign(scene.axesOptions, { tickColor: ink, labelColor: ink, gridColor: Array(3).fill([0.87, 0.87, 0.87, 1]) });
      still.src = scene.toImage("png");
      Object.assign(scene.axesOptions, { tickColor, labelColor, gridColor });
      scene.glplot.redraw();
      still.hidden = false;
    }, 800);
  }

  const STEP = Math.PI / 18;
  const TURNS = { left: [-STEP, 0, 1], right: [STEP, 0, 1], up: [0, STEP, 1], down: [0, -STEP, 1], closer: [0, 0, 1.15], farther: [0, 0, 1 / 1.15] };
  const KEYS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "closer", "=": "closer", "-": "farther", Home: "first" };

  // Turns the eye about z and up or down, or brings what is seen closer: the projection is parallel, so its scale counts.
  function turn(name) {
    const scene = plot._fullLayout.scene, camera = scene._scene.getCamera(), ratio = scene.aspectratio;
    if (name === "first") return Plotly.relayout(plot, { "scene.camera": layout().scene.camera, "scene.aspectratio": layout().scene.aspectratio });
    const [about, upwards, factor] = TURNS[name], { eye: from, center } = camera;
    const x = from.x - center.x, y = from.y - center.y, z = from.z - center.z, size = Math.hypot(x, y, z);
    const azimuth = Math.atan2(y, x) + about;
    const height = Math.min(1.5, Math.max(-1.5, Math.asin(z / size) + upwards)), level = size * Math.cos(height);
    const eye = { x: center.x + level * Math.cos(azimuth), y: center.y + level * Math.sin(azimuth), z: center.z + size * Math.sin(height) };
    const aspectratio = { x: factor * ratio.x, y: factor * ratio.y, z: factor * ratio.z };
    const turned = about || upwards ? { eye, up: { x: 0, y: 0, z: 1 } } : { eye: camera.eye, up: camera.up };
    return Plotly.relayout(plot, { "scene.camera": { ...turned, center, projection: { type: "orthographic" } }, "scene.aspectratio": aspectratio });
  }

  function turnable() {
    plot.addEventListener("keydown", (event) => {
      if (!KEYS[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      turn(KEYS[event.key]);
    });
    for (const button of document.querySelectorAll("#scene-turns button")) {
      button.addEventListener("click", () => turn(button.dataset.turn));
    }
    plot.on("plotly_relayout", keep);
    let width = plot.clientWidth, resized = 0;
    new ResizeObserver(() => {
      if (plot.clientWidth === width) return;
      width = plot.clientWidth;
      clearTimeout(resized);
      resized = setTimeout(draw, 200);
    }).observe(plot);
  }

  function listed() {
    for (const patch of patches) {
      const label = document.createElement("label"), box = document.createElement("input"), colour = document.createElement("i");
      box.type = "checkbox";
      box.checked = shownPatches.has(patch.name);
      colour.style.background = patch.colour;
      box.addEventListener("change", () => { shownPatches[box.checked ? "add" : "delete"](patch.name); draw(); });
      label.append(box, colour, patch.name);
      control("patches").append(label);
    }
  }

  function offered() {
    data.views.forEach((view, i) => control("view").add(new Option(view.name, String(i))));
    for (const name of ["view", "lines", "overlay", "box", "sites", "centres", "cells", "colour", "axis"]) {
      control(name).addEventListener("change", () => {
        if (control("axis").value !== "none" && name === "axis") { control("cells").checked = true; control("threshold").value = 1; }
        if (coloured() === "change" && name === "colour") control("cells").checked = true;
        draw();
      });
    }
    control("threshold").addEventListener("input", () => { control("cells").checked = true; draw(); });
    control("place").addEventListener("input", () => { if (control("axis").value !== "none") draw(); });
    for (const one of document.querySelectorAll("input[name=state]")) {
      one.addEventListener("change", () => { state = one.id.slice("scene-".length); draw(); });
    }
    listed();
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  }

  // The page's policy allows the library because it knows its digest: nothing else runs.
  async function library() {
    const script = document.createElement("script");
    script.textContent = await (await inflated("scene-library")).text();
    document.head.append(script);
  }

  offered();
  library().then(draw).then(turnable).catch((error) => without(String(error)));
})();
