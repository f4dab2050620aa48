// The page: hears the server ten times a second, shows one vehicle whole and all in the head line.

import { drawMap, drawMetering, drawRotor, shareSeen } from "./drawing.js";
import { Traces } from "./traces.js";

const SIDES = ["PS", "SS", "LE", "TE"];
const TITLES = ["Pressure side", "Suction side", "Leading edge", "Trailing edge"];
const BLADES = ["A", "B", "C"];
const STALE_S = 3;
const SURE_MS = 4000;
const PICTURE_MS = 200;
const TRAIL = 600;
const RUNNING = ["running", "paused"];
const token = document.querySelector("meta[name=token]").content;
const at = (id) => document.getElementById(id);

const seen = new Map(); // name -> {state, age_s, history, traces, trail}
let chosen = decodeURIComponent(location.hash.slice(1));
let heard = performance.now();

function remember(vehicle) {
  const known = seen.get(vehicle.name) ||
    { history: null, traces: new Traces(), trail: [], folder: null };
  const moved = known.state === undefined || vehicle.state.mission_s !== known.state.mission_s;
  known.state = vehicle.state;
  known.age_s = vehicle.age_s;
  known.metering = vehicle.metering;
  if (vehicle.history) known.history = vehicle.history;
  const progress = vehicle.state.progress;
  if (known.folder !== vehicle.state.mission_dir) {
    known.folder = vehicle.state.mission_dir;
    known.trail = [];
  }
  if (moved) {
    known.traces.add(performance.now() / 1000, {
      distance: progress.distance_m, clearance: progress.clearance_m, grey: vehicle.state.grey,
    });
    if (vehicle.state.position_w) known.trail.push(vehicle.state.position_w);
    if (known.trail.length > TRAIL) known.trail.shift();
  }
  seen.set(vehicle.name, known);
}

function put(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

function figure(id, value, digits, level = "") {
  put(id, value === null || value === undefined ? "–" : value.toFixed(digits));
  at(id).closest(".figure").classList.toggle("warn", level === "warn");
  at(id).closest(".figure").classList.toggle("bad", level === "bad");
}

const below = (value, warn, bad) =>
  value === null ? "" : value < bad ? "bad" : value < warn ? "warn" : "";

function drawTabs() {
  const nav = at("vehicles");
  const names = [...seen.keys()].sort();
  if (nav.childElementCount !== names.length) {
    nav.replaceChildren(...names.map((name) => {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.append(document.createElement("b"), document.createElement("span"));
      tab.addEventListener("click", () => choose(name));
      tab.dataset.name = name;
      return tab;
    }));
  }
  for (const tab of nav.children) {
    const { state, age_s } = seen.get(tab.dataset.name);
    const battery = state.battery === null ? "" : ` · ${Math.round(state.battery * 100)} %`;
    tab.firstChild.textContent = tab.dataset.name;
    tab.lastChild.textContent = age_s > STALE_S ? `silent for ${age_s.toFixed(0)} s`
      : `${state.progress.phase.replace("_", " ")}${battery}`;
    tab.classList.toggle("stale", age_s > STALE_S);
    tab.setAttribute("aria-current", tab.dataset.name === chosen);
  }
}

function choose(name) {
  chosen = name;
  location.hash = encodeURIComponent(name);
  unsure();
  draw();
}

function draw() {
  drawTabs();
  if (!seen.has(chosen)) chosen = [...seen.keys()].sort()[0] || "";
  const vehicle = seen.get(chosen);
  at("nobody").hidden = vehicle !== undefined;
  at("vehicle").hidden = at("foot").hidden = vehicle === undefined;
  if (vehicle === undefined) return;
  drawFigures(vehicle);
  drawInspection(vehicle);
  drawEvents(vehicle);
  drawButtons(vehicle);
  vehicle.traces.draw(at("traces"));
}

function drawFigures({ state, age_s }) {
  const p = state.progress;
  put("state", p.state.replace("_", " "));
  at("state").className = `chip ${p.state}`;
  put("phase", p.phase.replace("_", " "));
  put("words", p.words);
  figure("clearance", p.clearance_m, 1, below(p.clearance_m, 9, 8));
  const battery = state.battery === null ? null : state.battery * 100;
  figure("battery", battery, 0, below(battery, 35, 20));
  at("battery-bar").style.width = `${battery || 0}%`;
  figure("angle", p.stop_angle_deg, 1);
  put("sigma", p.sigma_deg === null ? "" : `± ${p.sigma_deg.toFixed(1)}`);
  figure("age", age_s, 1, age_s > STALE_S ? "bad" : age_s > 1 ? "warn" : "");
  put("coverage", (p.coverage * 100).toFixed(0));
  put("photos", String(p.photos));
  put("exposure", state.ev === null ? "" : `EV ${state.ev >= 0 ? "+" : "−"}${Math.abs(state.ev).toFixed(1)}` +
    (state.grey === null ? "" : ` · grey ${state.grey.toFixed(0)}`));
  const metre = p.metre === null ? "" : ` · ${p.metre.toFixed(0)} m`;
  const pass = p.pass_count ? ` · pass ${p.pass_index} of ${p.pass_count}` : "";
  put("pass", p.blade ? `${p.blade} ${p.side}${metre}${pass}` : "");
  at("vehicle").classList.toggle("stale", age_s > STALE_S);
}

function drawInspection({ state, history, trail, metering }) {
  drawMetering(at("metering"), at("picture").hidden ? null : metering);
  const turbines = history ? history.turbines : [];
  const turbine = turbines.find((one) => one.name === state.site) || turbines[0] || null;
  const photos = history ? history.photos : [];
  const length = turbine ? turbine.blade_length_m : 0;
  drawRotor(at("rotor"), state.progress, photos, length);
  drawMap(at("map"), state, turbine, history ? history.rotor : null, trail);
  drawSides(state.progress, photos, length);
}

function drawSides(progress, photos, length) {
  const table = at("sides");
  if (!table.rows.length) {
    const head = table.insertRow();
    head.append(...["", ...TITLES].map((text) =>
      Object.assign(document.createElement("th"), { textContent: text })));
    for (const blade of BLADES) {
      const row = table.insertRow();
      Object.assign(row.insertCell(), { textContent: blade, className: "name" });
      for (const side of SIDES) {
        const cell = row.insertCell();
        cell.id = `side-${blade}-${side}`;
        cell.innerHTML = '<div class="cell"><div class="bar"><i></i></div><span class="share"></span></div>';
      }
    }
  }
  for (const blade of BLADES) {
    for (const side of SIDES) {
      const share = shareSeen(photos, blade, side, length);
      const cell = at(`side-${blade}-${side}`);
      cell.classList.toggle("now", progress.blade === blade && progress.side === side);
      cell.querySelector("i").style.width = `${share * 100}%`;
      cell.querySelector(".share").textContent = share ? `${Math.round(share * 100)} %` : "–";
    }
  }
}

function drawEvents({ history }) {
  const events = history ? history.events.slice(-3) : [];
  const key = JSON.stringify(events);
  if (at("events").dataset.key === key) return;
  at("events").dataset.key = key;
  at("events").replaceChildren(...events.map((event) => {
    const line = document.createElement("li");
    const time = document.createElement("time");
    time.textContent = `${event.mission_s.toFixed(0)} s`;
    line.className = event.cleared ? "" : event.severity;
    line.append(time, event.text);
    return line;
  }));
}

function drawButtons({ state, age_s }) {
  const running = RUNNING.includes(state.progress.state);
  at("start").disabled = running || !state.link_ok;
  for (const id of ["pause", "skip", "stop", "abort"]) at(id).disabled = !running;
  const paused = state.progress.state === "paused";
  if (!at("pause").classList.contains("sure")) put("pause", paused ? "Resume" : "Pause");
}

// --- asking ---------------------------------------------------------------------------------------

async function ask(verb, fields = {}) {
  const vehicle = chosen;
  let reply;
  try {
    const answer = await fetch(`ask/${encodeURIComponent(vehicle)}/${verb}`, {
      method: "POST",
      headers: { "X-Bladescout-Token": token, "Content-Type": "application/json" },
      body: JSON.stringify(fields),
    });
    reply = answer.ok ? await answer.json() : { ok: false, text: await answer.text() };
  } catch {
    reply = { ok: false, text: "the console's server does not answer" };
  }
  return reply;
}

function toast(reply) {
  const box = at("toast");
  box.textContent = `${chosen}: ${reply.text}`;
  box.classList.toggle("bad", !reply.ok);
  box.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { box.hidden = true; }, 5000);
}

function unsure() {
  for (const button of document.querySelectorAll("button.sure")) {
    button.classList.remove("sure");
    button.innerHTML = button.dataset.words;
  }
}

// One tap asks, the second within four seconds does.
function twice(id, words, verb) {
  const button = at(id);
  button.addEventListener("click", async () => {
    if (button.classList.contains("sure")) {
      unsure();
      toast(await ask(verb));
      return;
    }
    unsure();
    button.dataset.words = button.innerHTML;
    button.classList.add("sure");
    button.innerHTML = `${words}<small>tap again</small>`;
    setTimeout(unsure, SURE_MS);
  });
}

at("pause").addEventListener("click", async () => {
  const paused = seen.get(chosen).state.progress.state === "paused";
  toast(await ask(paused ? "resume" : "pause"));
});
at("skip").addEventListener("click", async () => toast(await ask("skip")));
twice("stop", "Stop now?", "stop");
twice("abort", "Abort now?", "abort");

// --- starting -------------------------------------------------------------------------------------

function choices(id, names) {
  at(id).replaceChildren(...names.map((name) => {
    const label = document.createElement("label");
    const box = Object.assign(document.createElement("input"),
      { type: "checkbox", checked: true, value: name });
    label.append(box, name);
    return label;
  }));
}
choices("choose-blades", BLADES);
choices("choose-sides", SIDES);
const chosenOf = (id) => [...at(id).querySelectorAll("input:checked")].map((box) => box.value);

at("start").addEventListener("click", () => {
  const history = seen.get(chosen).history;
  put("start-vehicle", chosen);
  at("turbine").replaceChildren(...(history ? history.turbines : []).map((one) =>
    new Option(`${one.name} (${one.turbine})`, one.name)));
  at("locked").checked = false;
  put("start-reply", "");
  at("start-dialog").showModal();
});

async function begin(dry) {
  const reply = await ask("start", {
    site: at("turbine").value, operator: at("operator").value, rotor_locked: at("locked").checked,
    blades: chosenOf("choose-blades"), sides: chosenOf("choose-sides"), dry_run: dry,
    expires_utc_s: Date.now() / 1000 + 30,
  });
  put("start-reply", reply.text);
  if (reply.ok && !dry) {
    at("start-dialog").close();
    toast(reply);
  }
}
at("check").addEventListener("click", () => begin(true));
at("go").addEventListener("click", () => begin(false));

// --- hearing --------------------------------------------------------------------------------------

const live = new EventSource("live");
live.addEventListener("message", (message) => {
  const told = JSON.parse(message.data);
  heard = performance.now();
  put("who", told.who === "local" ? "" : `as ${told.who}`);
  told.vehicles.forEach(remember);
  draw();
});
setInterval(() => { at("lost").hidden = performance.now() - heard < 2000; }, 500);

async function nextPicture() {
  const vehicle = chosen;
  let shown = false;
  if (vehicle && !document.hidden) {
    try {
      const answer = await fetch(`picture/${encodeURIComponent(vehicle)}`);
      if (answer.status === 200) {
        const url = URL.createObjectURL(await answer.blob());
        const old = at("picture").src;
        at("picture").src = url;
        if (old) URL.revokeObjectURL(old);
        shown = true;
      }
    } catch {
      shown = false;
    }
  }
  at("picture").hidden = !shown;
  at("no-picture").hidden = shown;
  setTimeout(nextPicture, shown ? PICTURE_MS : 1000);
}
nextPicture();
