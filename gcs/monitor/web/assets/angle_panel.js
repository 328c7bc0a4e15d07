// The receiver in motion: its subtended angle against time, with the stop angle and the band in which the leg may end.
import { computed, watch } from "vue";
import { useCanvas } from "/assets/canvas.js";
import { age, course, degrees, inDegrees, metres, rate, seconds, signedMetres, speed } from "/assets/format.js";
import { angles, drawn, ended, inFocus, receivers, selected } from "/assets/store.js";

const LEFT = 52;
const RIGHT = 14;
const TOP = 12;
const BOTTOM = 24;
const SHORTEST_S = 10;

export default {
  setup() {
    const { canvas, redraw } = useCanvas((context, width, height, colours) => {
      context.clearRect(0, 0, width, height);
      const kept = inFocus.value && angles.get(inFocus.value.name);
      if (kept?.samples.length) chart(context, width, height, kept, colours);
    });
    watch([drawn, inFocus], redraw);
    addEventListener("themechange", redraw);

    const leg = computed(() => inFocus.value?.leg);
    const bearings = computed(() => inFocus.value?.bearings ?? {});
    const toGo = computed(() => (leg.value?.angle_rad === undefined ? null : angleLeft(leg.value)));
    const quality = computed(() => {
      const { age_s: old, sigma_rad: sigma } = bearings.value;
      if (ended.value) return "no longer heard";
      if (old === undefined) return "no bearings";
      if (old > 0.5) return "old";
      return sigma !== undefined && inDegrees(sigma) > 2 ? "noisy" : "good";
    });
    const flying = computed(() => receivers.value.filter((receiver) => receiver.leg));
    const words = computed(() => {
      if (!leg.value) return "Subtended angle against time";
      return `Subtended angle of ${inFocus.value.name} between ${leg.value.stop_reference.join(" and ")}: `
        + `${degrees(leg.value.angle_rad)}, it stops at ${degrees(leg.value.stop_angle_rad)}`;
    });
    return { canvas, inFocus, leg, bearings, toGo, quality, flying, words, selected, age, course, degrees, metres, rate, seconds, signedMetres, speed };
  },
  template: `
    <section class="panel angle-panel" aria-labelledby="angle-title">
      <header>
        <h2 id="angle-title">{{ flying.length || !inFocus ? "In motion" : "Last in motion" }}</h2>
        <span class="tools">
          <button v-for="receiver in flying.slice(0, 8)" :key="receiver.name" type="button" :aria-pressed="receiver.name === inFocus?.name"
            @click="selected = receiver.name">{{ receiver.name }}</button>
        </span>
      </header>
      <p v-if="!inFocus" class="empty">Nobody has flown yet.</p>
      <p v-else class="headline" data-test="in-motion">
        <strong>{{ inFocus.name }}</strong>
        <template v-if="leg">leg {{ leg.number }}, {{ course(leg) }}, until {{ leg.stop_reference.join(" ∠ ") }} is <b>{{ degrees(leg.stop_angle_rad) }}</b></template>
        <template v-else>{{ inFocus.state }}{{ inFocus.reason ? ": " + inFocus.reason : "" }}</template>
      </p>
      <canvas v-show="inFocus" ref="canvas" class="angle" role="img" :aria-label="words"></canvas>
      <dl v-if="inFocus" class="figures">
        <div class="big"><dt>angle</dt><dd>{{ degrees(leg?.angle_rad) }}</dd></div>
        <div class="big"><dt>to the stop</dt><dd>{{ degrees(toGo) }}</dd></div>
        <div><dt>rate</dt><dd>{{ rate(leg?.rate_radps) }}</dd></div>
        <div><dt>distance to go</dt><dd>{{ metres(leg?.remaining_m) }}</dd></div>
        <div><dt>time to go</dt><dd>{{ seconds(leg?.to_go_s) }}</dd></div>
        <div><dt>speed</dt><dd>{{ speed(leg?.progress_mps) }}</dd></div>
        <div><dt>off the line</dt><dd>{{ signedMetres(leg?.cross_track_m) }}</dd></div>
        <div><dt>bearing age</dt><dd>{{ age(bearings.age_s) }}</dd></div>
        <div><dt>bearings</dt><dd>{{ quality }}, σ {{ degrees(bearings.sigma_rad) }}</dd></div>
        <div><dt>may end within</dt><dd>± {{ degrees(leg?.band_rad) }}</dd></div>
      </dl>
    </section>`,
};

const wrapped = (rad) => Math.atan2(Math.sin(rad), Math.cos(rad));
const angleLeft = (leg) => wrapped(leg.stop_angle_rad - leg.angle_rad);

function chart(context, width, height, { leg, samples }, colours) {
  const stop = inDegrees(leg.stop_angle_rad);
  const points = samples.map(([at, rad]) => [at, stop - inDegrees(wrapped(leg.stop_angle_rad - rad))]);
  const last = points.at(-1)[0];
  const span = Math.max(SHORTEST_S, last - points[0][0]) * 1.05;
  const first = points[0][0];
  const band = inDegrees(leg.band_rad ?? 0);
  const low = Math.min(stop - band, ...points.map((point) => point[1]));
  const high = Math.max(stop + band, ...points.map((point) => point[1]));
  const room = Math.max(0.5, (high - low) * 0.12);
  const x = (at) => LEFT + ((at - first) / span) * (width - LEFT - RIGHT);
  const y = (deg) => TOP + ((high + room - deg) / (high - low + 2 * room)) * (height - TOP - BOTTOM);

  axes(context, { width, height, x, y, first, span, low: low - room, high: high + room }, colours);
  context.fillStyle = colours.band;
  context.fillRect(LEFT, y(stop + band), width - LEFT - RIGHT, Math.max(2, y(stop - band) - y(stop + band)));
  context.strokeStyle = colours.alert;
  context.lineWidth = 2;
  context.setLineDash([8, 4]);
  line(context, [[LEFT, y(stop)], [width - RIGHT, y(stop)]]);
  context.setLineDash([]);
  label(context, `stop ${stop.toFixed(1).replace("-", "−")}°`, width - RIGHT - 4, y(stop) + (y(stop) < height / 2 ? 14 : -12), "right", colours.alert, colours);
  context.strokeStyle = colours.moving;
  context.lineWidth = 3;
  line(context, points.map(([at, deg]) => [x(at), y(deg)]));
  const [at, deg] = points.at(-1);
  context.beginPath();
  context.arc(x(at), y(deg), 5, 0, 2 * Math.PI);
  context.fillStyle = colours.moving;
  context.fill();
}

function axes(context, { width, height, x, y, first, span, low, high }, colours) {
  const rule = (points) => {
    context.strokeStyle = colours.grid;
    context.lineWidth = 1;
    line(context, points);
  };
  const step = tick(high - low, 5);
  for (let deg = Math.ceil(low / step) * step; deg <= high; deg += step) {
    rule([[LEFT, y(deg)], [width - RIGHT, y(deg)]]);
    label(context, `${deg.toFixed(step < 1 ? 1 : 0).replace("-", "−")}°`, LEFT - 6, y(deg), "right", colours.muted, colours);
  }
  const stepS = tick(span, width / 90);
  for (let at = Math.ceil(first / stepS) * stepS; at <= first + span; at += stepS) {
    rule([[x(at), TOP], [x(at), height - BOTTOM]]);
    label(context, `${at.toFixed(0)} s`, x(at), height - 10, "center", colours.muted, colours);
  }
}

function tick(span, count) {
  const rough = span / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * (rough > 5 * power ? 10 : rough > 2 * power ? 5 : rough > power ? 2 : 1);
}

function line(context, points) {
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

function label(context, words, x, y, align, colour, colours) {
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineWidth = 4;
  context.strokeStyle = colours.paper;
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}
