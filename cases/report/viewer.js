"use strict";
// Draws the turnable picture from the JSON in #scene-data with plotly, which is in #scene-library, compressed.
// All names of the data go through text() or textContent.
(() => {
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const plot = document.getElementById("turnable");
  const control = (name) => document.getElementById("scene-" + name);
  const text = (name) => name.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0)).buffer;
  const numbers = (base64) => new Float32Array(bytes(base64));
  const column = (rows, width, which) => rows.filter((_, i) => i % width === which);
  const axes = (points) => ({ x: column(points, 3, 0), y: column(points, 3, 1), z: column(points, 3, 2) });

  function unpacked(part) {
    const points = numbers(part.points);
    return { ...part, points, moved: part.moved ? numbers(part.moved) : points, faces: new Uint32Array(bytes(part.faces)) };
  }

  const patches = data.patches.map(unpacked).map((patch) => (
    { ...patch, edges: patch.edges ? new Uint32Array(bytes(patch.edges)) : edges(patch.faces) }));
  const groups = data.cells.groups.map(unpacked).map((group) => ({
    ...group, cell: group.cell ? new Uint32Array(bytes(group.cell)) : null,
    quality: { undeflected: numbers(group.before), deflected: numbers(group.after) },
  }));
  const boxes = data.boxes.map((box) => numbers(box.segments));
  const dots = data.dots.map((one) => ({ ...one, points: numbers(one.points) }));
  const SIZE = 2.8; // diagonal of what is looked at, by the size of the picture: about 3 fills it
  let state = "deflected";

  const at = (part) => (state === "deflected" ? part.moved : part.points);

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
    const shown = patch.hidden ? "legendonly" : true;
    const common = { legendgroup: patch.name, name: text(patch.name), visible: shown };
    const mesh = {
      ...common, type: "mesh3d", ...axes(at(patch)), color: patch.colour, ...light,
      i: column(patch.faces, 3, 0), j: column(patch.faces, 3, 1), k: column(patch.faces, 3, 2),
      showlegend: true, hovertemplate: "%{x:.4f}, %{y:.4f}, %{z:.4f} " + text(data.unit) + "<extra>" + text(patch.name) + "</extra>",
    };
    const wire = {
      ...common, type: "scatter3d", mode: "lines", ...lines(at(patch), patch.edges), showlegend: false,
      line: { color: "#222222", width: 1.5 }, hoverinfo: "skip",
      visible: control("lines").checked ? shown : false,
    };
    return [mesh, wire];
  }

  function hexahedra() {
    const ends = (points) => Array.from({ length: points.length / 3 }, (_, i) => i);
    return boxes.map((points, i) => ({
      type: "scatter3d", mode: "lines", ...lines(points, ends(points)), name: text("hexahedron of " + data.boxes[i].name),
      line: { color: "#cc00cc", width: 4 }, hoverinfo: "skip", visible: control("hexahedron").checked,
    }));
  }

  const scattered = () => dots.map((one) => ({
    type: "scatter3d", mode: "markers", ...axes(one.points), name: text(one.name + " (" + one.count + ")"),
    marker: { size: 2.4, color: one.colour }, hoverinfo: "name",
    visible: control(one.group).checked,
  }));

  // The triangles around the cells of a group that are below the threshold.
  function outside(group, threshold) {
    const own = group.quality[state], i = [], j = [], k = [], intensity = [];
    const rows = group.faces.length / group.corners;
    for (let row = 0; row < rows; row += 1) {
      const value = own[group.cell ? group.cell[row] : row], first = row * group.corners;
      if (value >= threshold) continue;
      for (let t = 0; t < group.table.length; t += 3) {
        i.push(group.faces[first + group.table[t]]);
        j.push(group.faces[first + group.table[t + 2]]);
        k.push(group.faces[first + group.table[t + 1]]);
        intensity.push(value);
      }
    }
    return { i, j, k, intensity };
  }

  function bad() {
    const threshold = Number(control("threshold").value);
    const measure = data.measure.length > 24 ? "quality" : text(data.measure);
    const values = groups.flatMap((group) => Array.from(group.quality[state]));
    const count = values.filter((value) => value < threshold).length;
    const inverted = values.filter((value) => value <= 0).length;
    control("count").textContent =
      count + " of " + data.cells.all + " cells below " + threshold.toFixed(2) + ", " + inverted + " inverted";
    return groups.map((group, number) => ({
      type: "mesh3d", ...axes(at(group)), ...outside(group, threshold), intensitymode: "cell", ...light,
      colorscale: data.colours.shades, cmin: data.colours.range[0], cmax: data.colours.range[1], showlegend: false,
      showscale: number === 0,
      colorbar: { title: { text: measure, side: "right" }, len: 0.5, x: 1, xanchor: "right", y: 0.3, thickness: 14 },
      name: "cells", visible: control("cells").checked && count > 0,
      hovertemplate: "quality %{intensity:.3f}<extra></extra>",
    }));
  }

  function layout() {
    const view = data.views[control("view").value], ink = dark() ? "#d8d8d8" : "#333333", grid = dark() ? "#444444" : "#dddddd";
    const span = view.high.map((high, c) => high - view.low[c]), diagonal = Math.hypot(...span);
    const axis = (name, c) => ({
      title: { text: name + ", " + data.unit }, range: [view.low[c], view.high[c]], color: ink, gridcolor: grid, zeroline: false,
      showbackground: false, nticks: 6, showspikes: false, visible: c < 2 || !data.plane,
    });
    const above = { eye: { x: 0, y: 0, z: 2 }, up: { x: 0, y: 1, z: 0 }, projection: { type: "orthographic" } };
    const side = view.low[1] + view.high[1] > 2 * data.middle + 1e-3 * span[1] ? -1 : 1;
    const camera = { eye: { x: 1.1, y: -0.9 * side, z: 0.75 }, projection: { type: "orthographic" } };
    return {
      scene: {
        xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2), aspectmode: "manual",
        aspectratio: { x: SIZE * span[0] / diagonal, y: SIZE * span[1] / diagonal, z: SIZE * span[2] / diagonal },
        camera: data.plane ? above : camera, uirevision: view.name,
      },
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { family: "system-ui, sans-serif", color: ink },
      legend: { x: 0, xanchor: "left", y: 1, bgcolor: dark() ? "rgba(20,20,20,0.6)" : "rgba(255,255,255,0.7)", itemsizing: "constant", font: { size: 11 } },
      uirevision: view.name, hoverlabel: { namelength: -1 },
    };
  }

  const settings = {
    responsive: true, displaylogo: false, scrollZoom: true,
    modeBarButtonsToRemove: ["resetCameraLastSave3d", "hoverClosest3d", "tableRotation"],
  };

  function draw() {
    const traces = [...patches.flatMap(surface), ...hexahedra(), ...scattered(), ...bad()];
    return Plotly.react(plot, traces, layout(), settings).then(() => { plot.dataset.state = state; });
  }

  function offered() {
    data.views.forEach((view, i) => control("view").add(new Option(view.name, String(i))));
    for (const name of ["view", "lines", "hexahedron", "sites", "centres", "cells"]) {
      control(name).addEventListener("change", draw);
    }
    control("threshold").addEventListener("input", () => { control("cells").checked = true; draw(); });
    for (const name of ["undeflected", "deflected"]) {
      control(name).addEventListener("change", () => { state = name; draw(); });
    }
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  }

  function drawable() {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }

  // The page's policy allows the library because it knows its digest: nothing else runs.
  async function library() {
    const packed = new Blob([bytes(document.getElementById("scene-library").textContent)]);
    const script = document.createElement("script");
    script.textContent = await new Response(packed.stream().pipeThrough(new DecompressionStream("gzip"))).text();
    document.head.append(script);
  }

  function without(reason) {
    control("controls").hidden = true;
    plot.classList.add("empty");
    plot.textContent = "The turnable picture cannot be drawn: " + reason + " All else on this page is complete.";
  }

  document.getElementById("interactive-body").hidden = false;
  if (!drawable()) {
    without("this browser offers no WebGL.");
  } else if (typeof DecompressionStream === "undefined") {
    without("this browser is older than 2023.");
  } else {
    offered();
    library().then(draw).catch((error) => without(String(error)));
  }
})();
