// The page: steps the cloth frame by frame and shows it.

import init, { device, Toy } from "./cloth.js";
import { Chart } from "./chart.js";
import { View } from "./view.js";

const FRAME = 1 / 60;
const at = (id) => document.getElementById(id);
const chosen = () => document.querySelector("input[name=scene]:checked").value;

let toy = null;
let onGpu = false;
let paused = false;
let builds = 0;
let usual = ""; // what is said as long as nothing is wrong
let requested = 0; // when a state was last requested from the GPU
let milliseconds = null; // of a step, with the settings as they are
let owed = 0; // time that has passed and has not been simulated
let last = performance.now();

// The slider's number of substeps: 0 means as many as keep the strain; then 3 to 640 in quarters of octaves.
function substeps() {
  const notch = Number(at("substeps").value);
  return notch === 0 ? 0 : Math.round(5 * 2 ** (notch - 1));
}

function say(word, wrong = false) {
  at("word").textContent = word;
  at("word").classList.toggle("wrong", wrong);
}

function settings() {
  at("wind-said").value = `${Number(at("wind").value).toFixed(1)} m/s`;
  at("gravity-said").value = `${Number(at("gravity").value).toFixed(1)} m/s²`;
  at("substeps-said").value = substeps() || "as strain asks";
}

function measured(time) {
  milliseconds = milliseconds === null ? time : milliseconds + 0.1 * (time - milliseconds);
}

// Runs an action and shows its error, if any.
function attempt(what) {
  try {
    return what();
  } catch (error) {
    say(error.message ?? String(error), true);
    return undefined;
  }
}

async function build() {
  const scene = chosen();
  const wanted = at("gpu").checked;
  const number = ++builds;
  const found = wanted ? await device().catch(() => null) : null;
  if (number !== builds) return void found?.free(); // another choice was made meanwhile
  onGpu = found !== null;
  at("gpu").checked = onGpu;
  at("compare").disabled = onGpu;
  const made = attempt(() => new Toy(scene, Number(at("size").value), found ?? undefined));
  if (!made) return;
  toy?.free();
  toy = made;
  owed = 0;
  at("wind").value = { flag: 7, cape: 2 }[scene] ?? 0;
  apply();
  view.show(toy, scene === "cape" ? 2.5 : 0.45);
  chart.clear();
  usual = onGpu ? "Running on the GPU, through WebGPU." : wanted ? "This browser has no WebGPU; running on the CPU." : "Drag the cloth.";
  say(usual);
}

function apply() {
  settings();
  say(usual);
  milliseconds = null;
  attempt(() => toy.set(at("method").value, substeps(), at("levels").checked));
  toy.blow(Number(at("wind").value), Number(at("gravity").value));
  toy.compare(at("compare").checked);
  chart.label(`${at("method").value}, ${substeps() || "by strain"}${at("levels").checked ? "" : ", no levels"}`);
}

function step() {
  const start = performance.now();
  const done = attempt(() => (toy.step(), true));
  if (!done) return void pause(true);
  if (!onGpu) measured(performance.now() - start);
}

// The GPU's state is requested once the previous one has arrived, and drawn when it arrives.
function look() {
  if (!onGpu) return;
  if (attempt(() => toy.request())) requested = performance.now();
  const steps = attempt(() => toy.arrived()) ?? 0;
  if (steps > 0) measured((performance.now() - requested) / steps);
}

function tell() {
  const [mean, worst, energy, count, levels, error] = toy.report();
  at("ms").textContent = milliseconds === null ? "" : `${milliseconds.toFixed(2)} ms`;
  at("count").textContent = `${count}, ${levels}`;
  at("stretch").textContent = `${(100 * mean).toFixed(2)} %, ${(100 * worst).toFixed(1)} %`;
  at("energy").textContent = `${energy.toPrecision(3)} J/kg`;
  if (error >= 0 && milliseconds !== null) chart.add(milliseconds, 1000 * error);
}

function frame(now) {
  requestAnimationFrame(frame);
  owed = Math.min(owed + (now - last) / 1000, 3 * FRAME);
  last = now;
  if (!toy) return;
  while (!paused && owed >= FRAME && toy.ready()) {
    owed -= FRAME;
    step();
  }
  look();
  view.draw();
  tell();
}

function pause(stop) {
  if (!stop) say(usual);
  paused = stop;
  at("pause").textContent = paused ? "Continue" : "Pause";
}

// Dragging on the cloth grabs it; dragging beside it turns the view.
function hold(canvas) {
  let depth = null;
  let turning = null;
  const lead = (event) => {
    const [eye, way] = view.ray(event.offsetX, event.offsetY);
    toy.drag(eye.map((x, k) => x + way[k] * depth));
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (!toy || depth !== null) return;
    canvas.setPointerCapture(event.pointerId);
    const [eye, way] = view.ray(event.offsetX, event.offsetY);
    depth = attempt(() => toy.grab(new Float32Array(eye), new Float32Array(way))) ?? null;
    turning = depth === null ? [event.clientX, event.clientY] : null;
    canvas.classList.toggle("held", depth !== null);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (depth !== null) lead(event);
    else if (turning) {
      view.turn(0.008 * (event.clientX - turning[0]), 0.008 * (event.clientY - turning[1]));
      turning = [event.clientX, event.clientY];
    }
  });
  const release = () => {
    if (depth !== null) attempt(() => toy.release());
    [depth, turning] = [null, null];
    canvas.classList.remove("held");
  };
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, release);
  canvas.addEventListener("wheel", (event) => (event.preventDefault(), view.near(event.deltaY)), { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (turns) view.turn(...turns);
    else if (event.key === " ") pause(!paused);
    else if (event.key === "r") attempt(() => toy.reset());
    else return;
    event.preventDefault();
  });
}

const chart = new Chart(at("chart"));
const view = new View(at("view"));
hold(at("view"));
for (const id of ["wind", "gravity", "method", "substeps", "levels", "compare"]) at(id).addEventListener("input", () => toy && apply());
for (const id of ["scenes", "size", "gpu"]) at(id).addEventListener("change", build);
at("pause").addEventListener("click", () => pause(!paused));
at("reset").addEventListener("click", () => attempt(() => toy.reset()));
at("view").addEventListener("webglcontextlost", () => say((usual = "The browser has lost the picture; reload the page."), true));
at("settings").addEventListener("submit", (event) => event.preventDefault());

await init().catch((error) => (say(`The cloth could not be loaded: ${error.message}`, true), Promise.reject(error)));
await build();
requestAnimationFrame(frame);
// For the test of the page: the first picture is on the screen when the frame after it begins.
requestAnimationFrame(() => requestAnimationFrame(() => performance.mark("first picture")));
// Finding a GPU takes a while, so the page starts without waiting for it.
if (navigator.gpu) navigator.gpu.requestAdapter().then((adapter) => (at("gpu").disabled = !adapter), () => {});

// For the test of the page: runs some frames of a scene and returns the final positions.
window.play = async (scene, size, frames, gpu) => {
  const played = new Toy(scene, size, gpu ? await device() : undefined);
  played.set("small steps", 20, true);
  for (let k = 0; k < frames; k++) played.step();
  if (gpu) {
    played.request();
    while (!played.arrived()) await new Promise((next) => setTimeout(next, 5));
  }
  return Array.from(played.positions());
};
