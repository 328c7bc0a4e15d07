// Draws the formation from above, to scale. Signs and labels say what colours say.
import { inDegrees } from "/assets/format.js";
import { Pen } from "/assets/pen.js";
import { onCanvas, roundLength } from "/assets/view.js";

const TRAIL_M = 15;
const HALTED = new Set(["HELD", "PILOT", "FAILED"]);
const HALF_TURN = Math.PI;

// what there is to look at, for fitting the view
export function extent({ setup, vehicles }) {
  const points = [...Object.values(setup?.slots ?? {}), ...(setup?.transmitters ?? []).map((one) => one.at_m)];
  for (const route of setup?.routes ?? []) points.push(route.start_m, ...route.legs.map((leg) => leg.end_m));
  return points.concat(setup?.fence ?? [], vehicles.filter((one) => one.at_m).map((one) => one.at_m));
}

// Draw everything. `colours` are the page's own, by name; `scene` holds setup, state, tracks, selection and layers.
export function draw(context, width, height, view, scene, colours) {
  context.clearRect(0, 0, width, height);
  const pen = new Pen(context, view, colours, [0, 0, width, height]);
  grid(pen, width, height);
  if (scene.setup) {
    fence(pen, scene.setup.fence);
    if (scene.layers.plan) plan(pen, scene);
    slots(pen, scene);
  }
  if (scene.layers.tracks) tracks(pen, scene);
  reserve(pen, scene, width);
  for (const receiver of scene.receivers) if (receiver.leg) legInFlight(pen, scene, receiver);
  transmitters(pen, scene);
  vehicles(pen, scene);
  slotNames(pen, scene);
  compass(pen, width, scene.setup?.axis_azimuth_rad);
  ruler(pen, height);
}

function grid(pen, width, height) {
  const step = roundLength(pen.view, 110);
  const far = Math.hypot(width, height) / pen.view.scale;
  const [x, y] = centre(pen.view, width, height);
  const ends = (value) => [Math.floor((value - far) / step) * step, value + far];
  for (let [at, last] = ends(x); at <= last; at += step)
    pen.line([[at, y - far], [at, y + far]], pen.colours.grid, 1);
  for (let [at, last] = ends(y); at <= last; at += step)
    pen.line([[x - far, at], [x + far, at]], pen.colours.grid, 1);
}

// the point of the formation frame in the middle of the picture
function centre(view, width, height) {
  const x = (width / 2 - view.x) / view.scale;
  const y = (view.y - height / 2) / view.scale;
  const { cos, sin } = view.turned;
  return [x * cos + y * sin, -x * sin + y * cos];
}

function fence(pen, corners) {
  if (corners.length < 3) return;
  pen.line(corners, pen.colours.fence, 2.5, [10, 5], true);
  const highest = corners.map((corner) => pen.at(corner)).sort((a, b) => a[1] - b[1])[0];
  pen.text("fence", [highest[0] + 6, highest[1] + 10], { colour: pen.colours.fence, size: 12 });
}

function plan(pen, { setup, receivers, selected }) {
  const states = new Map(receivers.map((receiver) => [receiver.name, receiver]));
  for (const route of setup.routes) {
    const receiver = states.get(route.receiver);
    const chosen = selected === route.receiver;
    if (!chosen && (receiver?.state === "PLACED" || receiver?.leg)) continue;
    const colour = chosen ? pen.colours.select : pen.colours.plan;
    for (const leg of route.legs) pen.line([leg.start_m, leg.end_m], colour, chosen ? 2.5 : 1.25, [2, 4]);
    for (const leg of route.legs.slice(0, -1)) turningPoint(pen, leg.end_m, colour);
  }
}

function turningPoint(pen, point, colour) {
  const [x, y] = pen.at(point);
  const { context } = pen;
  context.beginPath();
  context.moveTo(x, y - 4);
  context.lineTo(x + 4, y);
  context.lineTo(x, y + 4);
  context.lineTo(x - 4, y);
  context.closePath();
  context.fillStyle = pen.colours.paper;
  context.fill();
  pen.stroke(colour, 1.5);
}

function slots(pen, { setup, receivers }) {
  const filled = new Set(receivers.filter((one) => one.state === "PLACED").map((one) => one.slot));
  for (const [name, place] of Object.entries(setup.slots)) {
    const at = pen.at(place);
    pen.ring(at, 10, pen.colours.slot, filled.has(name) ? 2.5 : 1.5, filled.has(name) ? [] : [3, 3]);
  }
}

// last, and only where there is room: the plan can be read in the table too
function slotNames(pen, { setup, receivers }) {
  const filled = new Set(receivers.filter((one) => one.state === "PLACED").map((one) => one.slot));
  for (const [name, place] of Object.entries(setup?.slots ?? {}))
    if (!filled.has(name)) pen.label(name, pen.at(place), { colour: pen.colours.muted, size: 12, apart: 12 });
}

// labels keep off the signs
function reserve(pen, { setup, vehicles }, width) {
  pen.taken.push([width - 52, 12, width - 8, 56]); // the compass
  for (const place of [...vehicles.map((one) => one.at_m), ...(setup?.transmitters ?? []).map((one) => one.at_m)]) {
    if (!place) continue;
    const [x, y] = pen.at(place);
    pen.taken.push([x - 8, y - 8, x + 8, y + 8]);
  }
}

function tracks(pen, { tracks: flown, selected }) {
  for (const [name, track] of flown) {
    pen.line(track, name === selected ? pen.colours.select : pen.colours.track, 1.5);
    pen.line(trail(track), name === selected ? pen.colours.select : pen.colours.trail, 3);
  }
}

// the last metres of a track
function trail(track) {
  let [first, length] = [track.length - 1, 0];
  while (first > 0 && length < TRAIL_M) {
    length += Math.hypot(track[first][0] - track[first - 1][0], track[first][1] - track[first - 1][1]);
    first--;
  }
  return track.slice(Math.max(first, 0));
}

function legInFlight(pen, scene, receiver) {
  const { leg } = receiver;
  pen.line([leg.start_m, leg.end_m], pen.colours.moving, 2.5, [9, 5]);
  turningPoint(pen, leg.end_m, pen.colours.moving);
  const vehicle = scene.vehicles.find((one) => one.name === receiver.name);
  const from = vehicle?.at_m ?? receiver.place_m;
  if (!from) return;
  for (const name of leg.stop_reference) {
    const place = placeOf(scene, name);
    if (place) pen.line([from, place], pen.colours.sight, 1.25, [1, 4]);
  }
  subtended(pen, scene, leg, from);
}

// the angle itself, as an arc between the two lines of sight
function subtended(pen, scene, leg, from) {
  const [first, second] = leg.stop_reference.map((name) => placeOf(scene, name));
  if (!first || !second || leg.angle_rad === undefined) return;
  const begin = onCanvas(pen.view, Math.atan2(first[1] - from[1], first[0] - from[0]));
  const [x, y] = pen.at(from);
  pen.context.beginPath();
  pen.context.arc(x, y, 26, begin, begin - leg.angle_rad, leg.angle_rad > 0);
  pen.stroke(pen.colours.sight, 2);
  const middle = begin - leg.angle_rad / 2;
  const words = `${inDegrees(leg.angle_rad).toFixed(1).replace("-", "−")}°`;
  pen.labelAlong(words, [x, y], middle, { colour: pen.colours.sight });
}

function placeOf({ setup, vehicles }, name) {
  const given = setup?.transmitters.find((one) => one.name === name);
  if (given) return given.at_m;
  return vehicles.find((one) => one.name === name)?.at_m ?? slotOf(setup, name);
}

function slotOf(setup, receiver) {
  return setup?.routes.find((route) => route.receiver === receiver)?.slot_m;
}

function transmitters(pen, { setup, vehicles, onAir }) {
  for (const { name, at_m: place, beacon } of setup?.transmitters ?? []) {
    const told = vehicles.find((one) => one.name === name)?.at_m ?? place;
    const at = pen.at(told);
    if (onAir.has(name)) waves(pen, at);
    const { context } = pen;
    context.beginPath();
    context.moveTo(at[0], at[1] - 8);
    context.lineTo(at[0] + 8, at[1] + 6);
    context.lineTo(at[0] - 8, at[1] + 6);
    context.closePath();
    context.fillStyle = onAir.has(name) ? pen.colours.emitting : pen.colours.paper;
    context.fill();
    pen.stroke(pen.colours.ink, 2);
    pen.label(beacon ? `${name} beacon` : name, at, { apart: onAir.has(name) ? 15 : 11, must: true });
  }
}

function waves(pen, at) {
  for (const radius of [13, 18])
    for (const side of [0, HALF_TURN]) {
      pen.context.beginPath();
      pen.context.arc(at[0], at[1], radius, side - 0.6, side + 0.6);
      pen.stroke(pen.colours.emitting, 2.5);
    }
}

function vehicles(pen, scene) {
  const given = new Set((scene.setup?.transmitters ?? []).map((one) => one.name));
  const states = new Map(scene.receivers.map((receiver) => [receiver.name, receiver]));
  const shown = [];
  for (const vehicle of scene.vehicles) {
    if (given.has(vehicle.name) || !vehicle.at_m) continue;
    shown.push([vehicle, states.get(vehicle.name)]);
  }
  for (const [vehicle, receiver] of shown) receiverSign(pen, scene, vehicle, receiver);
  const urgency = ([vehicle, receiver]) =>
    vehicle.name === scene.selected ? 0 : HALTED.has(receiver?.state) ? 1 : receiver?.leg ? 2 : 3;
  for (const [vehicle, receiver] of shown.sort((a, b) => urgency(a) - urgency(b))) name(pen, scene, vehicle, receiver, urgency([vehicle, receiver]) < 3);
}

function receiverSign(pen, scene, vehicle, receiver) {
  const { colours, context } = pen;
  const at = pen.at(vehicle.at_m);
  const kind = receiver ? scene.kindOf(receiver.state) : "waiting";
  const near = vehicle.nearest_m !== undefined && vehicle.nearest_m < 2 * (scene.setup?.min_separation_m ?? 0);
  if (scene.layers.separation && scene.setup && (kind === "moving" || near)) {
    const tooNear = vehicle.nearest_m !== undefined && vehicle.nearest_m < scene.setup.min_separation_m;
    pen.ring(at, scene.setup.min_separation_m * pen.view.scale, tooNear ? colours.alert : colours.muted, 1.5, [4, 3]);
  }
  if (scene.onAir.has(vehicle.name)) waves(pen, at);
  if (scene.selected === vehicle.name) pen.ring(at, 15, colours.select, 3);
  context.save();
  context.translate(at[0], at[1]);
  context.rotate(onCanvas(pen.view, vehicle.heading_rad ?? pen.view.upward));
  context.beginPath();
  if (vehicle.heading_rad === undefined) context.arc(0, 0, 6, 0, 2 * HALF_TURN);
  else [[10, 0], [-7, 6.5], [-3.5, 0], [-7, -6.5]].forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
  context.fillStyle = colours[kind];
  context.fill();
  context.restore();
  pen.stroke(colours.ink, 1.5);
}

function name(pen, scene, vehicle, receiver, must) {
  const halted = HALTED.has(receiver?.state);
  const words = halted ? `${vehicle.name} ${receiver.state}` : vehicle.name;
  pen.label(words, pen.at(vehicle.at_m), { colour: halted ? pen.colours.alert : pen.colours.ink, must });
}

function compass(pen, width, axisAzimuth) {
  if (axisAzimuth === undefined) return;
  const at = [width - 30, 34];
  const angle = onCanvas(pen.view, axisAzimuth);
  const { context } = pen;
  pen.disc(at, 20, pen.colours.paper);
  pen.ring(at, 20, pen.colours.muted, 1);
  context.beginPath();
  context.moveTo(at[0] - 13 * Math.cos(angle), at[1] - 13 * Math.sin(angle));
  context.lineTo(at[0] + 4 * Math.cos(angle), at[1] + 4 * Math.sin(angle));
  pen.stroke(pen.colours.ink, 2.5);
  pen.text("N", [at[0] + 12 * Math.cos(angle), at[1] + 12 * Math.sin(angle)], { size: 12, weight: 800, align: "center" });
}

function ruler(pen, height) {
  const length = roundLength(pen.view, 140);
  const [left, y] = [14, height - 16];
  const right = left + length * pen.view.scale;
  pen.context.beginPath();
  pen.context.moveTo(left, y - 6);
  pen.context.lineTo(left, y);
  pen.context.lineTo(right, y);
  pen.context.lineTo(right, y - 6);
  pen.stroke(pen.colours.ink, 2);
  pen.text(`${length} m`, [(left + right) / 2, y - 10], { size: 12, align: "center" });
}
