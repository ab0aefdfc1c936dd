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
  const reach = 40 / Math.max(1, Math.hypot(state.roll, state.pitch)); // the knob stays within its circle
  byId("knob").style.left = `${50 + reach * state.roll}%`;
  byId("knob").style.top = `${50 - reach * state.pitch}%`;
  byId("yaw").value = state.yaw;
  byId("stick").setAttribute("aria-valuetext", `roll ${number(100 * state.roll)} %, pitch ${number(100 * state.pitch)} %`);
  flight.surfaces.forEach(({ name }, k) => {
    byId(name).textContent = signed(amounts[k]);
    byId(name).parentElement.classList.toggle("moved", amounts[k] !== 0);
    byId(name).parentElement.hidden = alone() && k !== flight.meta.live;
  });
  byId("least").textContent = `${number(found.least, 3)} (${number(found.first, 3)} before)`;
  byId("count").textContent = number(found.count);
  byId("inverted").textContent = number(found.inverted);
  byId("inverted").classList.toggle("bad", found.inverted > 0);
  byId("worse").textContent = number(found.worse);
  for (const one of document.querySelectorAll("[data-steps]")) one.hidden = !one.dataset.steps.includes(state.step);
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
    scene.show({ points, before, now, surface: state.step === 1 || (moved && state.step === 6) ? state.surface : -1, outlines: state.step === 5 });
  }
  caption();
  controls();
}

function caption() {
  const count = Math.min(state.parts, state.field && state.field.centres ? state.field.centres.length : 0);
  const captions = {
    2: `${state.parts > count ? "the whole sum" : count === 1 ? "one function" : `${count} functions`}: grey is wanted, red is what it gives; blue: how far a point moves`,
    3: "grey: a grid carried along by s; red: cells that got worse; dark: inside out",
    4: "red discs: error at the sites; dots: centres; red cells: worse, or inside out",
  };
  byId("caption").textContent = alone() ? `y = ${flight.meta.section} m, nose to the left · ${captions[state.step]}`
    : state.step === 6 ? "this fighter's aileron at −12°, from above: its closed rib stays on the wing"
    : state.step === 5 ? "drag to turn · blue: how far it moved; dashed: where it was" : "drag to turn · a section follows the surface that you moved last; red: cells that got worse";
}

// Buttons that can be pressed, and the curve of step 4.
function controls() {
  const { field } = state, curve = byId("curve");
  curve.hidden = state.step !== 4;
  if (state.step === 4 && history.length) drawCurve(curve);
  byId("look").hidden = alone() || !scene;
  byId("more-parts").disabled = state.parts > 8;
  for (const name of ["more-1", "more-4", "more-20"]) byId(name).disabled = Boolean(field && field.centres && field.centres.length >= MOST);
  byId("sites").textContent = field && !tail.holds(field) ? "Put them back" : "Take the sites away";
}

// Two curves over the number of centres: the largest error on a logarithmic scale, and the cells that are inside out.
function drawCurve(canvas) {
  const pen = canvas.getContext("2d"), ratio = Math.min(2, window.devicePixelRatio || 1), width = canvas.clientWidth, height = canvas.clientHeight;
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  pen.scale(ratio, ratio);
  // Axes: centres from the first to 40 at least, and all at the right end; the margins (pixels) leave room for the words.
  const steps = history.filter(([count]) => count < tail.count), all = history.find(([count]) => count === tail.count);
  const first = history[0][0], last = Math.max(40, steps.at(-1)[0]), [left, right] = [54, all ? 40 : 8];
  const x = (count) => left + (width - left - right) * (Math.min(count, last) - first) / (last - first) + (count === tail.count ? right - 8 : 0);
  const panel = (above, below, y, value, ticks, word) => {
    Object.assign(pen, { font: "12px system-ui, sans-serif", fillStyle: hue("soft"), strokeStyle: hue("line"), lineWidth: 1, textAlign: "left" });
    pen.fillText(word, left, above - 6);
    pen.textAlign = "right";
    for (const [tick, text] of ticks) {
      pen.fillText(text, left - 4, y(tick) + 4);
      pen.strokeRect(left, y(tick), width - left - right, 0);
    }
    Object.assign(pen, { strokeStyle: hue("moves"), fillStyle: hue("moves"), lineWidth: 2 });
    pen.beginPath();
    steps.forEach((row, i) => pen[i ? "lineTo" : "moveTo"](x(row[0]), y(value(row))));
    pen.stroke();
    for (const row of [steps[0], steps.at(-1), ...(all ? [all] : [])]) {
      pen.beginPath();
      pen.arc(x(row[0]), y(value(row)), 3, 0, 2 * Math.PI);
      pen.fill();
    }
  };
  const middle = height / 2, [top, low] = [0.04, 0.0004];
  const size = (error) => 18 + (middle - 30) * Math.log(top / Math.min(top, Math.max(low, error))) / Math.log(top / low);
  panel(18, middle, size, (row) => row[1], [0.03, 0.01, 0.003, 0.001].map((error) => [error, length(error).replace(".0", "")]), "largest error");
  const most = Math.max(10, ...history.map((row) => row[2])), number_ = (count) => height - 22 - (height - 22 - middle - 18) * count / most;
  panel(middle + 18, height - 22, number_, (row) => row[2], [[0, "0"], [most, `${most}`]], "cells inside out");
  const whole = steps.find((row) => row[2] === 0);
  Object.assign(pen, { fillStyle: hue("soft"), strokeStyle: hue("soft"), lineWidth: 1, textAlign: "left" });
  pen.fillText(`${first}`, left, height - 6);
  if (whole && whole !== steps[0]) {
    pen.setLineDash([3, 3]);
    pen.strokeRect(x(whole[0]), 12, 0, height - 34);
    pen.setLineDash([]);
    pen.textAlign = "center";
    pen.fillText(`${whole[0]}: none`, x(whole[0]), height - 6);
  }
  pen.textAlign = "right";
  pen.fillText(all ? "all" : `${last}`, width - 8, height - 6);
}

// Begin the greedy choice; rows of the curves have centres, largest error and cells inside out, at the angle of then.
function begin() {
  amounts = asked();
  state.field = tail.greedy();
  history = [];
  noted();
}
function noted() {
  const { field } = state;
  place(flight, amounts, points);
  tail.place(field, angle(), points);
  judge(points, flight.cells, flight.live.cells, now);
  history.push([field.centres ? field.centres.length : tail.count, tail.largest(field, angle()), judged().inverted]);
}
function more(count) {
  if (!state.field.centres) begin();
  for (let k = Math.min(count, MOST - state.field.centres.length); k > 0; k -= 1) {
    state.field = tail.more(state.field, 1, angle());
    noted();
  }
}
function all() {
  if (!state.field.centres) return;
  state.field = tail.withAll();
  noted();
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
  byId("proof").hidden = step !== 6;
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

// At first the stick goes forward by itself, so far and so long (ms), until somebody takes it.
const FORWARD = 0.6, LASTS = 2000;
function shown() {
  const begin = performance.now(), said = byId("hint"), text = said.textContent;
  let taken = false;
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, () => { taken = true; said.textContent = text; }, { once: true });
  const step = () => {
    if (taken || state.step !== 1) return;
    const share = Math.min(1, (performance.now() - begin) / LASTS);
    hold(0, FORWARD * share, order.tail_left);
    if (share < 1) requestAnimationFrame(step); else said.textContent = `Now you. ${text}`;
  };
  requestAnimationFrame(step);
}

// Every change of the stick goes through here: by pointer, or by keys.
function hold(roll, pitch, surface) {
  if (scene && state.surface === order.rudder && surface !== order.rudder) scene.look("fly");
  Object.assign(state, { roll: alone() ? 0 : within(roll), pitch: within(pitch), surface: alone() ? flight.meta.live : surface });
  fly();
}

const ACTS = {
  "more-parts": () => { state.parts += 1; }, "all-parts": () => { state.parts = 9; }, "one-part": () => { state.parts = 1; }, sites,
  "more-1": () => more(1), "more-4": () => more(4), "more-20": () => more(20), "all-centres": all, again: begin,
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
byId("look").addEventListener("click", () => scene.look(state.step === 5 ? "blend" : "fly"));
byId("yaw").addEventListener("input", () => {
  if (scene && state.step === 1 && state.surface !== order.rudder) scene.look("rudder");
  Object.assign(state, { yaw: Number(byId("yaw").value), surface: order.rudder });
  fly();
});
byId("release").addEventListener("click", () => { state.yaw = 0; hold(0, 0, state.surface); });
byId("view").addEventListener("keydown", (event) => {
  const way = { ArrowLeft: [-10, 0, 1], ArrowRight: [10, 0, 1], ArrowUp: [0, 10, 1], ArrowDown: [0, -10, 1], "+": [0, 0, 1.2], "-": [0, 0, 1 / 1.2] }[event.key];
  if (!scene || alone() || (!way && event.key !== "Home")) return;
  event.preventDefault();
  if (way) scene.turn(...way); else scene.look(state.step === 5 ? "blend" : "fly");
});

byId("proof-picture").src = `data:image/webp;base64,${byId("proof-data").textContent}`;
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
if (scene && !still && !location.hash) shown();
document.body.dataset.ready = "yes";
// What tests ask for.
window.fly = {
  flight, tail, points, state, Interpolant, scaling, hold, fly,
  get amounts() { return amounts; }, get history() { return history; }, judged, at: (hash) => { location.hash = hash; opened(); },
};
