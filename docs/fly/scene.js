// The fighter, its boxes and a section of its mesh, drawn by three.js.
// Edges at which the skin turns by more (cosine of 35 degrees) are part of a surface's outline.
const CREASE = 0.82;
// Views: the direction to the eye (degrees around z and above the horizon), the centre, and half of the height (m).
const VIEWS = {
  fly: { around: -38, above: 32, at: [0.6, -0.02, 0.005], half: 0.285 },
  rudder: { around: 55, above: 24, at: [0.86, 0, 0.12], half: 0.16 },
  blend: { around: -40, above: 38, at: [0.8, -0.17, 0], half: 0.14 },
};
const CORNERS = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

class FighterScene {
  constructor(host, flight, still) {
    Object.assign(this, { host, flight, still, view: { ...VIEWS.fly } });
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.scene = new THREE.Scene();
    this.camera = new THREE.OrthographicCamera();
    this.camera.up.set(0, 0, 1);
    const light = new THREE.DirectionalLight("#ffffff", 1.6);
    light.position.set(-0.4, 0.8, 1);
    light.target.position.set(0, 0, -1);
    this.camera.add(light, light.target);
    this.scene.add(this.camera, new THREE.AmbientLight("#ffffff", 1.9));
    const { domElement } = this.renderer;
    host.prepend(domElement);
    domElement.setAttribute("aria-hidden", "true");
    this.controls = new THREE.OrbitControls(this.camera, domElement);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.render());
    domElement.style.touchAction = "pan-y"; // a finger up or down moves the page
    this.place = new THREE.BufferAttribute(new Float32Array(flight.start), 3);
    this.shades = new THREE.BufferAttribute(new Float32Array(flight.start.length), 3);
    this.moving = flight.patches.filter((patch) => patch.moves).map(({ first, faces }) => [...new Set(flight.faces.subarray(3 * first, 3 * (first + faces)))]);
    this.solids = flight.patches.map((patch) => this.solid(patch));
    this.wires = this.lines(this.place, edgesOf(flight.faces), true);
    this.sections = flight.surfaces.map((one) => this.section(one));
    this.boxes = flight.surfaces.map(({ box }) => this.lines(new THREE.BufferAttribute(dashed(CORNERS.map((pair) => pair.map((i) => box[i])), 0.004), 3)));
    const first = (i) => Array.from(flight.start.subarray(3 * i, 3 * i + 3));
    this.outlines = flight.patches.filter((patch) => patch.moves === "surface").map((patch) => {
      const pairs = outlineOf(flight, patch), segments = pairs.map((pair) => pair.map(first));
      return { before: this.lines(new THREE.BufferAttribute(dashed(segments, 0.003), 3)), now: this.lines(this.place, pairs.flat()) };
    });
    this.sized();
    new ResizeObserver(() => { this.sized(); this.render(); }).observe(host);
  }

  solid(patch) {
    const geometry = new THREE.BufferGeometry(), material = new THREE.MeshLambertMaterial({
      flatShading: true, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    geometry.setAttribute("position", this.place);
    geometry.setAttribute("color", this.shades);
    geometry.setIndex(new THREE.BufferAttribute(this.flight.faces.slice(3 * patch.first, 3 * (patch.first + patch.faces)), 1));
    return this.added(new THREE.Mesh(geometry, material));
  }

  lines(place, pairs = null, faint = false) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", place);
    if (pairs) geometry.setIndex(new THREE.BufferAttribute(Uint16Array.from(pairs), 1));
    return this.added(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: faint, opacity: faint ? 0.24 : 1 })));
  }

  added(object) {
    object.frustumCulled = false;
    this.scene.add(object);
    return object;
  }

  section(surface) {
    const cut = new Section(this.flight, surface, this.flight.cells, surface.cells), geometry = new THREE.BufferGeometry();
    for (const [name, width] of [["position", 3], ["color", 4]]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(width * cut.triangles.length), width));
    const material = new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    const place = new THREE.BufferAttribute(cut.points, 3);
    return { cut, cells: this.added(new THREE.Mesh(geometry, material)), lines: this.lines(place, cut.lines, true), place };
  }

  // Show the mesh with nodes at points, the section and the box of a surface (-1: none). If asked for, show the outlines
  // of before, and colour what moves by how far it moved.
  show({ points, before, now, surface, outlines }) {
    this.place.array.set(points);
    this.place.needsUpdate = true;
    if (outlines) this.coloured(points);
    this.flight.patches.forEach((patch, i) => {
      const { material } = this.solids[i], wanted = Boolean(outlines && patch.moves);
      if (material.vertexColors === wanted) return;
      Object.assign(material, { vertexColors: wanted, needsUpdate: true });
      this.inked();
    });
    this.sections.forEach(({ cut, cells, lines, place }, k) => {
      cells.visible = lines.visible = this.boxes[k].visible = k === surface;
      if (k !== surface) return;
      cut.follow(points);
      place.needsUpdate = true;
      const corners = cells.geometry.getAttribute("position"), colours = cells.geometry.getAttribute("color");
      const [worse, inverted] = ["worse", "inverted"].map((name) => new THREE.Color(hue(name)).toArray());
      let filled = 0;
      cut.rows.forEach((row, i) => {
        const own = shade(before[row], now[row]);
        if (own < 0) return;
        const colour = own === SHADES ? [...inverted, 1] : [...worse, 0.25 + 0.6 * own / SHADES];
        for (let c = 0; c < 3; c += 1) {
          const corner = 3 * cut.triangles[3 * i + c];
          corners.array.set(cut.points.subarray(corner, corner + 3), 3 * filled);
          colours.array.set(colour, 4 * filled);
          filled += 1;
        }
      });
      cells.geometry.setDrawRange(0, filled);
      corners.needsUpdate = colours.needsUpdate = true;
    });
    for (const one of this.outlines) one.before.visible = one.now.visible = outlines;
    this.render();
  }

  // Colour nodes from grey (stays) to blue (moves most of its patch).
  coloured(points) {
    const { start } = this.flight, colours = this.shades.array;
    const [rest, full] = ["stays", "moves"].map((name) => new THREE.Color(hue(name)).toArray());
    for (const nodes of this.moving) {
      const far = nodes.map((node) => Math.hypot(points[3 * node] - start[3 * node], points[3 * node + 1] - start[3 * node + 1], points[3 * node + 2] - start[3 * node + 2]));
      const most = Math.max(...far, 1e-9);
      nodes.forEach((node, i) => {
        for (let c = 0; c < 3; c += 1) colours[3 * node + c] = rest[c] + far[i] / most * (full[c] - rest[c]);
      });
    }
    this.shades.needsUpdate = true;
  }

  // Take the colours of the page's scheme.
  inked() {
    this.flight.patches.forEach((patch, i) => {
      const { color } = this.solids[i].material;
      color.set(hue(patch.moves ? "moves" : "stays"));
      if (patch.moves === "panel") color.lerp(new THREE.Color(hue("stays")), 0.6);
      if (patch.name === "canopy") color.multiplyScalar(0.7);
      if (this.solids[i].material.vertexColors) color.set("#ffffff");
    });
    this.wires.material.color.set(hue("edge"));
    for (const { lines } of this.sections) lines.material.color.set(hue("edge"));
    for (const box of this.boxes) box.material.color.set(hue("box"));
    for (const { before, now } of this.outlines) { before.material.color.set(hue("soft")); now.material.color.set(hue("edge")); }
  }

  look(name) {
    const to = VIEWS[name], from = { ...this.view }, begin = performance.now(), duration = 700; // ms
    cancelAnimationFrame(this.frame);
    const step = () => {
      const t = this.still ? 1 : Math.min(1, (performance.now() - begin) / duration), share = t * t * (3 - 2 * t);
      for (const key of ["around", "above", "half"]) this.view[key] = from[key] + share * (to[key] - from[key]);
      this.view.at = from.at.map((value, c) => value + share * (to.at[c] - value));
      const [around, above] = [this.view.around, this.view.above].map((angle) => Math.PI / 180 * angle);
      const eye = [Math.cos(above) * Math.cos(around), Math.cos(above) * Math.sin(around), Math.sin(above)];
      this.camera.position.set(...eye.map((value, c) => this.view.at[c] + 2 * value));
      this.controls.target.set(...this.view.at);
      this.camera.zoom = 1;
      this.controls.update();
      this.render();
      if (t < 1) this.frame = requestAnimationFrame(step);
    };
    step();
  }

  // Turn (degrees) and come closer (factor), for the keyboard.
  turn(around, above, closer) {
    const offset = this.camera.position.clone().sub(this.controls.target), radius = offset.length();
    const azimuth = Math.atan2(offset.y, offset.x) + Math.PI / 180 * around;
    const height = Math.max(-1.5, Math.min(1.5, Math.asin(offset.z / radius) + Math.PI / 180 * above));
    offset.set(Math.cos(height) * Math.cos(azimuth), Math.cos(height) * Math.sin(azimuth), Math.sin(height)).multiplyScalar(radius);
    this.camera.position.copy(this.controls.target).add(offset);
    this.camera.zoom *= closer;
    this.controls.update();
    this.render();
  }

  sized() {
    const { clientWidth: width, clientHeight: height } = this.renderer.domElement;
    if (width && height) this.renderer.setSize(width, height, false);
    this.shape = width && height ? height / width : 1;
  }

  render() {
    const up = this.view.half * Math.max(1, 1.5 * this.shape), across = up / this.shape;
    Object.assign(this.camera, { left: -across, right: across, top: up, bottom: -up, near: 0.1, far: 5 });
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }
}

function edgesOf(faces) {
  const seen = new Set(), out = [];
  for (let i = 0; i < faces.length; i += 1) {
    const a = faces[i], b = faces[i % 3 === 2 ? i - 2 : i + 1], key = Math.min(a, b) * 65_536 + Math.max(a, b);
    if (!seen.has(key)) { seen.add(key); out.push(a, b); }
  }
  return out;
}

// Pairs of nodes on the outline of a patch: its border, and the edges at which its skin turns.
function outlineOf({ faces, start }, { first, faces: count }) {
  const seen = new Map(), point = (node) => new THREE.Vector3().fromArray(start, 3 * node);
  for (let t = 3 * first; t < 3 * (first + count); t += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => point(faces[t + k])), normal = b.clone().sub(a).cross(c.sub(a)).normalize();
    for (let k = 0; k < 3; k += 1) {
      const pair = [faces[t + k], faces[t + (k + 1) % 3]].sort((p, q) => p - q), key = pair.join();
      seen.set(key, seen.has(key) && seen.get(key).normal.dot(normal) > CREASE ? { pair: null, normal } : { pair, normal });
    }
  }
  return [...seen.values()].map((one) => one.pair).filter(Boolean);
}

// Segments, each a pair of points, cut into dashes of a length (m) with gaps as long.
function dashed(segments, length) {
  return Float32Array.from(segments.flatMap(([from, to]) => {
    const count = Math.max(1, Math.round(Math.hypot(...from.map((value, c) => to[c] - value)) / length / 2));
    return Array.from({ length: count }, (_, i) => [i, i + 0.5].flatMap((end) => from.map((value, c) => value + (to[c] - value) * end / count))).flat();
  }));
}
