// Steps, stick and pedals, readouts, and the address by which each state can be opened.
const byId = (id) => document.getElementById(id);
const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
if (typeof DecompressionStream === "undefined") {
  byId("caption").textContent = "This browser is older than 2023 and cannot unpack the mesh. How it works has the same steps in pictures.";
  throw new Error("no DecompressionStream");
}
const flight = await unpacked("flight");
const tail = new Tail(flight), order = Object.fromEntries(flight.surfaces.map((one, k) => [one.name, k]));
const before = new Float64Array(flight.cells.length / 4), now = new Float64Array(before.length), points = flight.start.slice();
judge(flight.start, flight.cells, [...before.keys()], before);
now.set(before);
// Steps about the tail alone, by `confined.py`; the others have the plan's fields.
const ALONE = [2, 3, 4];
// Largest number of centres that are added one by one: here a fit takes the cube of it.
const MOST = 200;
const state = { step: 1, roll: 0, pitch: 0, yaw: 0, surface: order.tail_left, parts: 1, field: null };
let amounts = [0, 0, 0, 0, 0], history = [], scene = null;
const picture = new SectionPicture(byId("section"), flight, tail);
const alone = () => ALONE.includes(state.step);
const angle = () => amounts[flight.meta.live];
const formats = [0, 1, 2, 3].map((digits) => new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }));
const number = (value, digits = 0) => formats[digits].format(value);
const signed = (value) => `${value < 0 ? "−" : value ? "+" : ""}${Math.abs(value).toFixed(1)}°`;
const length = (metres) => (metres < 1e-9 ? "0" : `${number(1e3 * metres, metres < 1e-3 ? 2 : 1)} mm`);

// The share of a surface's range that the hands ask for.
function asked() {
  const shares = { aileron_left: state.roll, aileron_right: -state.roll, tail_left: state.pitch, tail_right: state.pitch, rudder: -state.yaw };
  return flight.surfaces.map(({ name, low, high }) => {
    const share = alone() && name !== "tail_left" ? 0 : shares[name];
    return share < 0 ? -share * low : share * high;
  });
}

// Move the mesh to what the hands ask for, and judge the cells that may have changed.
function fly() {
  const earlier = amounts;
  amounts = asked();
  place(flight, amounts, points);
  if (alone() && state.field) tail.place(state.field, angle(), points);
  flight.surfaces.forEach((one, k) => {
    if (amounts[k] || earlier[k] || k === flight.meta.live) judge(points, flight.cells, one.cells, now);
  });
  readouts();
  draw();
}

function judged() {
  const rows = alone() ? flight.live.cells : now.keys();
  let [least, first, inverted, worse, count] = [1, 1, 0, 0, 0];
  for (const row of rows) {
    least = Math.min(least, Math.max(0, now[row]));
    first = Math.min(first, before[row]);
    inverted += now[row] < 0;
    worse += before[row] - Math.max(0, now[row]) > flight.meta.worse;
    count += 1;
  }
  return { least, first, inverted, worse, count };
}

function readouts() {
  const found = judged(), { field } = state;
  byId("knob").style.left = `${50 + 40 * state.roll}%`;
  byId("knob").style.top = `${50 - 40 * state.pitch}%`;
  byId("yaw").value = state.yaw;
  byId("stick").setAttribute("aria-valuetext", `roll ${number(100 * state.roll)} %, pitch ${number(100 * state.pitch)} %`);
  flight.surfaces.forEach(({ name }, k) => {
    byId(name).textContent = signed(amounts[k]);
    byId(name).parentElement.classList.toggle("moved", amounts[k] !== 0);
    byId(name).parentElement.hidden = alone() && k !== flight.meta.live;
  });
  byId("least").textContent = `${number(found.least, 3)} (${number(found.first, 3)} before)`;
  byId("inverted").textContent = `${number(found.inverted)} of ${number(found.count)}`;
  byId("inverted").classList.toggle("bad", found.inverted > 0);
  byId("worse").textContent = number(found.worse);
  for (const one of document.querySelectorAll(".alone")) one.hidden = !alone();
  if (!alone()) return;
  byId("centres").textContent = number(field.centres ? field.centres.length : tail.count);
  byId("error").textContent = length(tail.largest(field, angle()));
  byId("jump").textContent = length(tail.holds(field) ? 0 : tail.jump(field, angle()));
  byId("motion").textContent = length(tail.motion(tail.values, 0, tail.onTail, angle()));
}

function draw() {
  if (alone()) {
    const shows = { 2: { parts: state.parts, centres: true }, 3: { lattice: true, jump: true, inverted: true }, 4: { centres: true, errors: true } }[state.step];
    picture.draw({ points, before, now, field: state.field, angle: angle(), shows });
  } else if (scene) {
    const moved = amounts.some(Boolean);
    scene.show({ points, before, now, surface: moved && state.step !== 5 ? state.surface : -1, outlines: state.step === 5 });
  }
  caption();
  controls();
}

function caption() {
  const count = Math.min(state.parts, state.field && state.field.centres ? state.field.centres.length : 0);
  const captions = {
    2: state.parts > count ? `the whole sum: at most ${length(picture.top || 0)} in the section, as the tail moves`
      : `${count === 1 ? "one function" : `${count} functions`}: at most ${length(picture.top || 0)} in the section`,
    3: "red: cells that got worse, and inside out; grey: a lattice in the field",
    4: "red discs: error at the sites; dots: centres; red cells: worse, or inside out",
  };
  byId("caption").textContent = alone() ? `y = ${flight.meta.section} m, nose to the left · ${captions[state.step]}`
    : state.step === 5 ? "drag to turn · blue: how far it moved; dashed: where it was" : "drag to turn · a section follows the surface that you moved last; red: cells that got worse";
}

// Buttons that can be pressed, and the curve of step 4.
function controls() {
  const { field } = state, curve = byId("curve");
  curve.hidden = state.step !== 4;
  if (state.step === 4 && history.length) drawCurve(curve);
  byId("more-parts").disabled = state.parts > 8;
  for (const name of ["more-1", "more-4", "more-20"]) byId(name).disabled = Boolean(field && field.centres && field.centres.length >= MOST);
  byId("sites").textContent = field && !tail.holds(field) ? "Put them back" : "Take the sites away";
}

// The largest error over the number of centres, on a logarithmic scale.
function drawCurve(canvas) {
  const pen = canvas.getContext("2d"), ratio = Math.min(2, window.devicePixelRatio || 1), width = canvas.clientWidth, height = canvas.clientHeight;
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  pen.scale(ratio, ratio);
  // Axes: centres from the first to 40 at least, errors in metres; the margins (pixels) leave room for the words.
  const first = history[0][0], last = Math.max(40, history.at(-1)[0]), [top, low] = [0.04, 0.0004], [left, right, above, below] = [54, 8, 8, 22];
  const x = (count) => left + (width - left - right) * (count - first) / (last - first);
  const y = (error) => above + (height - above - below) * Math.log(top / Math.max(low, error)) / Math.log(top / low);
  Object.assign(pen, { font: "12px system-ui, sans-serif", fillStyle: hue("soft"), strokeStyle: hue("line"), textAlign: "right" });
  for (const error of [0.03, 0.01, 0.003, 0.001]) {
    pen.fillText(length(error).replace(".0", ""), left - 4, y(error) + 4);
    pen.strokeRect(left, y(error), width - left - right, 0);
  }
  pen.textAlign = "left";
  pen.fillText(`${first}`, x(first), height - 6);
  pen.textAlign = "right";
  pen.fillText(`${last} centres`, x(last), height - 6);
  Object.assign(pen, { strokeStyle: hue("moves"), lineWidth: 2 });
  pen.beginPath();
  history.forEach(([count, error], i) => pen[i ? "lineTo" : "moveTo"](x(count), y(error)));
  pen.stroke();
}

// Begin the greedy choice; the errors of the curve are those at the angle of then.
function begin() {
  amounts = asked();
  state.field = tail.greedy();
  history = [[state.field.centres.length, tail.largest(state.field, angle())]];
}
function more(count) {
  if (!state.field.centres) begin();
  state.field = tail.more(state.field, Math.min(count, MOST - state.field.centres.length), angle(), (...row) => history.push(row));
}

// Go to a step; the tail turns to the end of its range where it is alone. `hands` are roll, pitch and yaw, if given.
function enter(step, hands = {}) {
  Object.assign(state, { step, parts: 1, field: null });
  if (alone()) Object.assign(state, { roll: 0, pitch: 1, yaw: 0, surface: flight.meta.live });
  if (step === 5) Object.assign(state, { roll: 1, pitch: 1, yaw: 0 });
  Object.assign(state, hands);
  if (step === 3) state.field = tail.withAll();
  if (step === 2 || step === 4) begin();
  for (const button of document.querySelectorAll("#steps button")) {
    if (Number(button.value) === step) button.setAttribute("aria-current", "step"); else button.removeAttribute("aria-current");
  }
  for (const text of document.querySelectorAll("#says section")) text.hidden = text.id !== `step-${step}`;
  byId("section").hidden = !alone();
  picture.plot.fitted = false;
  byId("view").classList.toggle("flat", alone());
  byId("yaw").disabled = alone();
  if (scene) scene.look(step === 5 ? "blend" : "fly");
}

// Open the state that the address names: step, roll, pitch, yaw (shares), surface, more (centres), sites=0, parts.
function opened() {
  const wanted = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const step = Number(wanted.step), given = ["roll", "pitch", "yaw"].filter((name) => wanted[name]);
  enter(step >= 1 && step <= 6 ? Math.floor(step) : 1, Object.fromEntries(given.map((name) => [name, within(Number(wanted[name]) || 0)])));
  const moved = state.yaw ? "rudder" : Math.abs(state.roll) > Math.abs(state.pitch) ? "aileron_left" : "tail_left";
  state.surface = order[alone() ? "tail_left" : wanted.surface in order ? wanted.surface : moved];
  if (state.step === 3 && wanted.sites === "0") sites();
  if (state.step === 2 && wanted.parts) state.parts = Math.max(1, Math.min(9, Math.floor(Number(wanted.parts)) || 1));
  if (state.step === 4 && Number(wanted.more) > 0) more(Math.min(MOST, Math.floor(Number(wanted.more))));
  fly();
}
const within = (value) => Math.max(-1, Math.min(1, value));

function sites() {
  state.field = tail.holds(state.field) ? tail.withoutBox() : tail.withAll();
}

// Every change of the stick goes through here: by pointer, or by keys.
function hold(roll, pitch, surface) {
  Object.assign(state, { roll: alone() ? 0 : within(roll), pitch: within(pitch), surface: alone() ? flight.meta.live : surface });
  fly();
}

const ACTS = {
  "more-parts": () => { state.parts += 1; }, "all-parts": () => { state.parts = 9; }, "one-part": () => { state.parts = 1; }, sites,
  "more-1": () => more(1), "more-4": () => more(4), "more-20": () => more(20), "all-centres": () => { state.field = tail.withAll(); }, again: begin,
};
for (const [id, act] of Object.entries(ACTS)) byId(id).addEventListener("click", () => { act(); fly(); });
for (const button of document.querySelectorAll("#steps button")) {
  button.addEventListener("click", () => {
    window.history.replaceState(null, "", `#step=${button.value}`);
    enter(Number(button.value));
    fly();
  });
}
for (const button of document.querySelectorAll("[data-copies]")) {
  button.addEventListener("click", async () => {
    const code = byId(button.dataset.copies);
    window.getSelection().selectAllChildren(code);
    if (navigator.clipboard) await navigator.clipboard.writeText(code.textContent);
    button.textContent = navigator.clipboard ? "Copied" : "Marked";
  });
}

const stick = byId("stick");
function drag(event) {
  const area = stick.getBoundingClientRect(), x = (event.clientX - area.left) / area.width - 0.5, y = 0.5 - (event.clientY - area.top) / area.height;
  const size = Math.max(0.4, Math.hypot(x, y));
  hold(x / size, y / size, Math.abs(x) > Math.abs(y) ? order.aileron_left : order.tail_left);
}
stick.addEventListener("pointerdown", (event) => { stick.setPointerCapture(event.pointerId); drag(event); });
stick.addEventListener("pointermove", (event) => { if (stick.hasPointerCapture(event.pointerId)) drag(event); });
stick.addEventListener("keydown", (event) => {
  const way = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
  if (!way && event.key !== "0") return;
  event.preventDefault();
  if (way) hold(state.roll + way[0], state.pitch + way[1], way[0] ? order.aileron_left : order.tail_left);
  else hold(0, 0, state.surface);
});
byId("yaw").addEventListener("input", () => { Object.assign(state, { yaw: Number(byId("yaw").value), surface: order.rudder }); fly(); });
byId("release").addEventListener("click", () => { state.yaw = 0; hold(0, 0, state.surface); });
byId("view").addEventListener("keydown", (event) => {
  const way = { ArrowLeft: [-10, 0, 1], ArrowRight: [10, 0, 1], ArrowUp: [0, 10, 1], ArrowDown: [0, -10, 1], "+": [0, 0, 1.2], "-": [0, 0, 1 / 1.2] }[event.key];
  if (!scene || alone() || (!way && event.key !== "Home")) return;
  event.preventDefault();
  if (way) scene.turn(...way); else scene.look(state.step === 5 ? "blend" : "fly");
});

byId("figure-picture").src = `data:image/svg+xml,${encodeURIComponent(await (await inflated("figure")).text())}`;
if (document.createElement("canvas").getContext("webgl2")) {
  const library = document.createElement("script");
  library.textContent = await (await inflated("library")).text();
  document.head.append(library);
  scene = new FighterScene(byId("view"), flight, still);
  scene.inked();
} else byId("view").classList.add("without");
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { hues.clear(); if (scene) scene.inked(); draw(); });
new ResizeObserver(() => { picture.plot.fitted = false; if (alone()) draw(); }).observe(byId("view"));
window.addEventListener("hashchange", opened);
opened();
document.body.dataset.ready = "yes";
// What tests ask for.
window.fly = {
  flight, tail, points, state, Interpolant, scaling, hold, fly,
  get amounts() { return amounts; }, get history() { return history; }, judged, at: (hash) => { location.hash = hash; opened(); },
};
