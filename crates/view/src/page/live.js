"use strict";
// The page's side of the connection, and what the operator does.

const at = (id) => document.getElementById(id);
const token = location.hash.slice(1);
const PHASES = ["idle", "launch", "open", "hold", "land", "abort"];
const FAULTS = ["no voltages reached the board for 300 ms", "a command was out of range", "outputs do not read what they were set to", "its supply sagged"];
const live = { socket: null, client: null, about: null, state: {}, totals: {}, ended: false, heard: 0, viewed: 0, set: false };
let traces = null;
let space = null;

// Connection.

function connect() {
  if (live.ended) return;
  const socket = (live.socket = new WebSocket(`ws://${location.host}/live`));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(JSON.stringify({ token }));
  socket.onmessage = ({ data }) => (typeof data === "string" ? hear(JSON.parse(data)) : see(data));
  socket.onclose = ({ code }) => {
    live.socket = null;
    live.client = null;
    if (code === 4000) live.ended = true;
    if (code === 4401) {
      live.ended = true;
      banner("This address is not that of the bench that runs now. Open the one on its terminal, with all that stands behind the #.");
    }
    show();
    if (!live.ended) setTimeout(connect, 1000);
  };
}

function send(command) {
  if (live.socket?.readyState === WebSocket.OPEN) live.socket.send(JSON.stringify(command));
}

function hear(message) {
  live.heard = performance.now();
  if (message.type === "welcome") {
    live.client = message.client;
    if (!live.about || JSON.stringify(live.about) !== JSON.stringify(message.about)) begin(message.about);
  } else if (message.type === "history") {
    // A connection that came back tells all again.
    traces.table = new Table();
    at("events").replaceChildren();
    message.batches.forEach(take);
    show();
  } else if (message.type === "batch") {
    take(message);
  } else if (message.type === "state") {
    live.state = message;
    show();
  } else if (message.type === "answer") {
    const line = at("answer");
    line.textContent = message.words;
    line.classList.toggle("bad", !message.done);
  } else if (message.type === "lagged") {
    tell(null, "warning", `this browser was too slow and misses ${message.batches} parts of the traces; the recording has them`);
  }
}

function begin(about) {
  live.about = about;
  document.title = `${about.mission} · bench live`;
  at("title").textContent = `${about.mission} on ${about.rig}`;
  at("subtitle").textContent = `${about.airframe}, ${about.mode === "hil" ? "through the board, in real time" : about.real_time ? "simulated, in real time" : "simulated"}`;
  at("foot").textContent = `bench ${about.version}. ${about.description}`;
  at("views").hidden = !about.views;
  at("key-truth").hidden = !about.truth;
  at("phases").replaceChildren(...about.phases.map(([name]) => Object.assign(document.createElement("li"), { textContent: name })));
  at("plots").replaceChildren();
  traces = new Traces(at("plots"), about);
  space = new Space(at("space"), about);
  if (!about.real_time && about.mode === "sim") at("window").value = "0";
  const limits = (id, [low, high], value) => {
    for (const field of [at(id), at(`${id}-slide`)]) Object.assign(field, { min: low, max: high, value });
  };
  limits("altitude", about.envelope_m.map((m) => Number(m.toFixed(3))), about.altitude_m ?? about.envelope_m[0]);
  if (about.flight_time_limits_s) limits("time", about.flight_time_limits_s.map((s) => Number(s.toFixed(3))), about.flight_time_s);
  at("time-set").hidden = !about.flight_time_limits_s;
}

function take(batch) {
  live.totals = batch.totals;
  live.flown = performance.now();
  traces.take(batch);
  for (const [time, level, words] of batch.event ?? []) tell(time, level, words);
  live.drawn = false;
}

function tell(time, level, words) {
  const line = document.createElement("li");
  line.className = level;
  const when = document.createElement("time");
  when.textContent = time === null ? "" : `${time.toFixed(1)} s`;
  const what = document.createElement("span");
  what.textContent = words;
  line.append(when, what);
  at("events").prepend(line);
  while (at("events").children.length > 200) at("events").lastChild.remove();
}

// Views: time, then three lengths and images.

async function see(data) {
  const view = new DataView(data);
  let from = 8;
  const images = ["full", "red", "depth"].map((name) => {
    const length = view.getUint32(from, true);
    const image = new Blob([data.slice(from + 4, from + 4 + length)], { type: "image/jpeg" });
    from += 4 + length;
    return [name, createImageBitmap(image)];
  });
  try {
    for (const [name, image] of images) {
      const bitmap = await image;
      at(name).getContext("2d").drawImage(bitmap, 0, 0);
      bitmap.close();
    }
    live.viewed += 1;
    live.views = [...(live.views ?? []), performance.now()];
  } finally {
    send({ command: "seen" });
  }
}

// What is shown of it.

function banner(words, warn = false) {
  const line = at("banner");
  line.hidden = !words;
  line.textContent = words ?? "";
  line.classList.toggle("warn", warn);
}

function show() {
  const { state, about, client, socket, ended } = live;
  if (!about) return;
  const stage = state.stage;
  const connected = socket?.readyState === WebSocket.OPEN && client !== null;
  const mine = connected && state.operator === client;
  const over = stage === "landed" || stage === "closed";
  const pill = at("link");
  pill.textContent = connected ? { preparing: "preparing", waiting: "ready", starting: "starting", flying: about.real_time ? "live" : "flying", landed: "landed", closed: "ended" }[stage] ?? "" : ended ? "ended" : "no connection";
  pill.className = `pill ${!connected && !ended ? "gone" : stage === "flying" ? "live" : ""}`;
  at("role").textContent = !connected ? "" : mine ? `You have the command; ${looking(state.clients - 1)}.` : state.operator === null ? "Nobody has the command." : "Somebody else has the command. You may watch, and press STOP.";
  at("take").hidden = !connected || state.operator !== null;
  at("release").hidden = !mine || state.clients < 2;
  at("checked").replaceChildren(...(state.checked ?? []).map((line) => Object.assign(document.createElement("li"), { textContent: line })));
  const waiting = stage === "waiting";
  at("start").hidden = !(waiting || stage === "preparing");
  at("start").disabled = !(mine && waiting);
  at("fly-at").hidden = stage !== "flying";
  at("fly-at").disabled = !mine;
  at("land").disabled = !(mine && stage === "flying" && about.phases.some(([name]) => name === "land"));
  at("end").hidden = !(mine && (stage === "landed" || waiting));
  const settable = mine && ((waiting && about.altitude_m !== null) || stage === "flying");
  for (const id of ["altitude", "altitude-slide"]) at(id).disabled = !settable;
  for (const id of ["time", "time-slide"]) at(id).disabled = !(mine && waiting);
  at("altitude-why").textContent = waiting && about.altitude_fixed ? `${about.altitude_fixed}.` : "";
  if (!settable && state.altitude_m != null) for (const id of ["altitude", "altitude-slide"]) at(id).value = state.altitude_m;
  if (!waiting && state.flight_time_s != null) for (const id of ["time", "time-slide"]) at(id).value = state.flight_time_s;
  at("outcome").hidden = !over || !state.headline;
  if (over) {
    at("outcome").style.setProperty("--tone", `var(--${state.passed ? "good" : "bad"})`);
    at("answer").textContent = "";
    at("headline").textContent = state.headline;
    at("words").textContent = state.words;
  }
  warn();
  live.drawn = false;
}

const looking = (count) => (count <= 0 ? "nobody else looks" : count === 1 ? "one other looks" : `${count} others look`);

function warn() {
  const { state, about, socket, client, ended, totals } = live;
  if (!about) return;
  const connected = socket?.readyState === WebSocket.OPEN && client !== null;
  if (!connected && !ended) {
    banner("The connection to the bench is gone. STOP does not reach it from here: use Ctrl-C on its terminal, or the hand controller. Trying to connect again.");
    return;
  }
  if (state.stage === "closed" || ended) {
    if (state.stage === "closed") banner("The bench has ended. What it flew stays here until this page is closed.", true);
    return;
  }
  if (state.stage === "waiting" && state.warning) {
    banner(state.warning, true);
    return;
  }
  const silent = (performance.now() - (live.flown ?? live.heard)) / 1000;
  if (state.stage === "flying" && silent > Math.max(1, 5 * about.period_s)) {
    banner(`The loop has said nothing for ${silent.toFixed(0)} s.`);
    return;
  }
  const table = traces.table;
  if (state.stage === "flying" && table.last("status") === 1) {
    banner("The tracker does not see the marker.", true);
    return;
  }
  const faults = table.last("faults") ?? 0;
  const told = FAULTS.filter((_, bit) => (faults >> bit) & 1);
  if (state.stage === "flying" && told.length) {
    banner(`The board says: ${told.join("; ")}.`, true);
    return;
  }
  if (state.stage === "flying" && totals.overruns > (live.overruns ?? 0)) {
    live.overruns = totals.overruns;
    live.overran = performance.now();
  }
  if (live.overran && performance.now() - live.overran < 3000) {
    banner(`Overrun: an iteration took longer than its ${(1e3 * about.period_s).toFixed(0)} ms; ${totals.overruns} so far.`, true);
    return;
  }
  banner(null);
}

function figures() {
  const { table } = traces;
  const kind = "estimated";
  const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1"));
  at("now-z").textContent = number(table.last(`${kind}.z`), 2);
  const phase = table.last("phase");
  const held = PHASES[phase] === "hold" || PHASES[phase] === "land";
  at("now-set").textContent = held ? number(table.last("wanted.z"), 2) : "–";
  at("now-time").textContent = table.time.length ? number(table.time[table.time.length - 1] - (live.began ?? 0), 1) : "–";
  at("now-over").textContent = live.totals.ticks ? String(live.totals.overruns) : "–";
  at("now-over").classList.toggle("bad", live.totals.overruns > 0);
  const chips = [...at("phases").children];
  const name = phase === null ? null : PHASES[phase];
  const stage = live.state.stage;
  const over = (stage === "landed" || stage === "closed") && name !== "abort";
  let here = -1;
  if (name !== null && stage !== "waiting" && !over) {
    // A mission may hold more than once: the next chip of that name is meant, or the one before that was it already.
    here = chips.findIndex((chip, i) => i >= (live.chip ?? 0) && chip.textContent === name);
    // Behind the last phase the sticks rest until the last positions are in.
    if (here < 0) here = chips.length - 1;
    if (name !== "abort") live.chip = here;
  }
  if (name === "abort" && !chips.some((chip) => chip.textContent === "abort")) {
    at("phases").append(Object.assign(document.createElement("li"), { textContent: "abort" }));
  }
  chips.forEach((chip, i) => {
    chip.className = i === here ? (name === "abort" ? "here abort" : "here") : over || i < (name === "abort" ? (live.chip ?? 0) + 1 : here) ? "past" : "";
  });
  live.views = (live.views ?? []).filter((time) => performance.now() - time < 2000);
  at("views-age").textContent = live.views.length ? `${Math.round(live.views.length / 2)} a second` : "";
}

// What changes is drawn 15 times a second, and less often where all of a long flight is shown.
function draw() {
  if (traces && !live.drawn && !document.hidden) {
    live.drawn = true;
    traces.draw(Number(at("window").value));
    space.draw(traces.table);
    figures();
  }
  warn();
  const long = traces && traces.table.time.length > 6000 && at("window").value === "0";
  setTimeout(() => requestAnimationFrame(draw), long ? 300 : 66);
}

// What the operator does.

function stop() {
  send({ command: "stop" });
  at("answer").textContent = live.socket ? "STOP sent" : "STOP does not reach the bench: no connection";
}

at("stop").addEventListener("click", stop);
// The space bar stops, whatever has the focus; Enter presses buttons.
addEventListener("keydown", (event) => {
  if (event.code !== "Space" || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  if (!event.repeat) stop();
}, true);
// A key that nothing is typed with, as all fields are numbers.
addEventListener("keydown", (event) => {
  if (event.key.toLowerCase() !== "l" || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  if (!event.repeat && live.state.stage === "flying") send({ command: "land" });
}, true);
at("land").addEventListener("click", () => send({ command: "land" }));
addEventListener("keyup", (event) => event.code === "Space" && event.preventDefault(), true);
at("take").addEventListener("click", () => send({ command: "take" }));
at("release").addEventListener("click", () => send({ command: "release" }));
at("end").addEventListener("click", () => send({ command: "end" }));
at("start").addEventListener("click", () => {
  const wanted = (id, value) => (value === null ? null : Number(at(id).value));
  send({ command: "start", altitude_m: wanted("altitude", live.about.altitude_m), flight_time_s: wanted("time", live.about.flight_time_s) });
});
at("fly-at").addEventListener("click", () => send({ command: "altitude", altitude_m: Number(at("altitude").value) }));
at("altitude").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && !at("fly-at").hidden) at("fly-at").click();
});
for (const id of ["altitude", "time"]) {
  at(id).addEventListener("input", () => (at(`${id}-slide`).value = at(id).value));
  at(`${id}-slide`).addEventListener("input", () => (at(id).value = at(`${id}-slide`).value));
}
at("window").addEventListener("change", () => (live.drawn = false));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  traces?.again();
  live.drawn = false;
});
document.addEventListener("visibilitychange", () => (live.drawn = false));

connect();
draw();
