// What the page knows of the run: kept up to date over one WebSocket, read by every panel.
import { computed, reactive, ref, shallowRef } from "vue";

const STALE_MS = 2500;
const ABOUT_MS = 2000;
const EVENTS_KEPT = 2000;
const SAMPLES_KEPT = 1200;
const LONGEST_WAIT_MS = 3000;
const GATHER_MS = 5; // what has come by then counts as one

export const setup = shallowRef(null);
export const state = shallowRef(null);
export const events = shallowRef([]);
export const socketOpen = ref(false);
export const heardMs = ref(0); // when the last state came, by performance.now(); 0 before the first
export const nowMs = ref(performance.now());
export const about = reactive({ role: "VIEW", csrf: "", commanding: false, signed_in: false, report: null, problem: null });
export const selected = ref(null); // the vehicle looked at
export const drawn = ref(0); // grows with each state, so that canvases follow

// not reactive: canvases read them whenever they draw
export const tracks = new Map(); // vehicle -> [[x, y], ...]
export const angles = new Map(); // receiver -> {leg, samples: [[elapsed_s, angle_rad, rate_radps, age_s], ...]}
export const spans = shallowRef(new Map()); // receiver -> Map(s since the run began -> the state it came into)
export const latency = { shown: [] }; // ms from the service's sending to our having it on screen

export const stale = computed(() => nowMs.value - heardMs.value > STALE_MS);
export const ageS = computed(() => Math.max(0, nowMs.value - heardMs.value) / 1000);
export const receivers = computed(() => state.value?.receivers ?? []);
export const vehicles = computed(() => state.value?.vehicles ?? []);
export const receiverOf = (name) => receivers.value.find((receiver) => receiver.name === name);
export const onAir = computed(() => new Set(state.value?.on_air ?? []));
export const taken = computed(() => new Set(state.value?.taken ?? []));
export const ended = computed(() => ["formed", "completed", "aborted", "failed"].includes(state.value?.phase));

// whoever the angle panel is about: the one chosen while it has something to show, else the one in motion
export const inFocus = computed(() => {
  void drawn.value; // the angles are not reactive
  const chosen = receiverOf(selected.value);
  if (chosen?.leg || (chosen && angles.has(chosen.name))) return chosen;
  const flying = receivers.value.find((receiver) => receiver.leg);
  if (flying) return flying;
  let latest = null;
  for (const receiver of receivers.value)
    if (angles.has(receiver.name) && (latest === null || receiver.since_s > latest.since_s)) latest = receiver;
  return latest ?? chosen ?? null;
});

export function select(name) {
  selected.value = selected.value === name ? null : name;
}

export const remembered = {
  get(key, otherwise) {
    try {
      return localStorage.getItem(`bearing-relay.${key}`) ?? otherwise;
    } catch {
      return otherwise;
    }
  },
  set(key, value) {
    try {
      localStorage.setItem(`bearing-relay.${key}`, value);
    } catch {
      // a browser that keeps nothing shows the same page
    }
  },
};

function takeSetup(message) {
  if (setup.value?.run !== message.run) loadPast();
  setup.value = message;
  drawn.value++;
}

function takeState(message) {
  const before = state.value;
  if (before && before.run === message.run && message.number < before.number) return;
  if (before && before.run !== message.run) forget();
  state.value = message;
  heardMs.value = nowMs.value = performance.now();
  for (const vehicle of message.vehicles ?? []) extendTrack(vehicle);
  for (const receiver of message.receivers ?? []) {
    extendAngle(receiver, message.elapsed_s);
    extendSpans(receiver.name, [[receiver.since_s, receiver.state]]);
  }
  drawn.value++;
  requestAnimationFrame(() => {
    latency.shown.push(Date.now() - message.sent_ns / 1e6);
    if (latency.shown.length > 2000) latency.shown.splice(0, 1000);
  });
}

// another run has begun
function forget() {
  if (setup.value?.run === state.value?.run) setup.value = null;
  tracks.clear();
  angles.clear();
  spans.value = new Map();
  events.value = [];
  selected.value = null;
  about.report = null;
}

function extendTrack(vehicle) {
  if (!vehicle.at_m) return;
  const track = tracks.get(vehicle.name) ?? [];
  const last = track.at(-1);
  if (last && Math.hypot(vehicle.at_m[0] - last[0], vehicle.at_m[1] - last[1]) < 0.5) return;
  track.push(vehicle.at_m);
  if (track.length > SAMPLES_KEPT) track.splice(0, track.length, ...track.filter((_, index) => index % 2 === 0));
  tracks.set(vehicle.name, track);
}

function extendAngle(receiver, elapsedS) {
  const leg = receiver.leg;
  if (!leg || leg.angle_rad === undefined) return;
  let kept = angles.get(receiver.name);
  if (!kept || kept.leg.number !== leg.number || kept.leg.stop_angle_rad !== leg.stop_angle_rad) {
    kept = { leg, samples: [] };
    angles.set(receiver.name, kept);
  }
  kept.leg = leg;
  const last = kept.samples.at(-1);
  if (last && last[0] >= elapsedS) return;
  kept.samples.push([elapsedS, leg.angle_rad, leg.rate_radps ?? null, receiver.bearings?.age_s ?? null]);
  if (kept.samples.length > SAMPLES_KEPT) kept.samples.splice(0, kept.samples.length - SAMPLES_KEPT);
}

function extendSpans(name, entered) {
  const known = spans.value.get(name) ?? new Map();
  const fresh = entered.filter(([from, state]) => known.get(from) !== state);
  if (fresh.length) spans.value = new Map(spans.value).set(name, new Map([...known, ...fresh].sort((a, b) => a[0] - b[0])));
}

function takeEvents(news) {
  const known = new Map(events.value.map((event) => [event.number, event]));
  const size = known.size;
  for (const event of news) known.set(event.number, event);
  if (known.size === size) return;
  events.value = [...known.values()].sort((a, b) => a.number - b.number).slice(-EVENTS_KEPT);
}

async function loadPast() {
  try {
    const past = await (await fetch("/past")).json();
    if (!past.run || past.run !== state.value?.run) return;
    for (const [name, track] of Object.entries(past.tracks)) tracks.set(name, track);
    for (const [name, { samples, ...leg }] of Object.entries(past.angles)) angles.set(name, { leg, samples });
    for (const [name, entered] of Object.entries(past.spans)) extendSpans(name, entered);
    takeEvents(past.events);
    drawn.value++;
  } catch {
    // the socket says that nobody is there; it is asked again when somebody is
  }
}

let waitMs = 250;

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/v1/live`);
  let begun = false;
  let newest = null; // the text of the latest state, until it is looked at
  const takeNewest = () => {
    takeState(JSON.parse(newest).state);
    newest = null;
    if (!begun) loadPast();
    begun = true;
  };
  socket.onmessage = ({ data }) => {
    if (data.startsWith('{"state"')) {
      if (newest === null) setTimeout(takeNewest, GATHER_MS);
      newest = data; // a device that cannot keep up leaves states out, and never shows an old one as live
      return;
    }
    const said = JSON.parse(data);
    if (said.setup) takeSetup(said.setup);
    if (said.event) takeEvents([said.event]);
  };
  socket.onopen = () => {
    waitMs = 250;
    socketOpen.value = true;
    loadAbout();
  };
  socket.onclose = () => {
    socketOpen.value = false;
    setTimeout(connect, waitMs);
    waitMs = Math.min(2 * waitMs, LONGEST_WAIT_MS);
  };
}

async function loadAbout() {
  try {
    const answer = await fetch("/about");
    if (answer.status === 401) location.assign("/login");
    else if (answer.ok) Object.assign(about, await answer.json());
  } catch {
    // the socket says that nobody is there
  }
}

// Return what the relay answered: {ok, message}.
export async function command(verb, vehicle) {
  try {
    const answer = await fetch("/control", {
      method: "POST",
      headers: { "content-type": "application/json", "x-csrf-token": about.csrf },
      body: JSON.stringify(vehicle ? { verb, vehicle } : { verb }),
    });
    return await answer.json();
  } catch {
    return { ok: false, message: "the dashboard cannot be reached: use `bearing-relay control`, or the pilot's own link" };
  }
}

export async function signOut() {
  await fetch("/logout", { method: "POST", headers: { "x-csrf-token": about.csrf } });
  location.assign("/");
}

let started = false;

export function start() {
  if (started) return;
  started = true;
  connect();
  setInterval(() => (nowMs.value = performance.now()), 250);
  setInterval(() => socketOpen.value && (ended.value ? !about.report : stale.value) && loadAbout(), ABOUT_MS);
}
