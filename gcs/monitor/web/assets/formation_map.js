// The formation from above: pan by dragging or arrow keys, zoom by wheel, pinch or + and -.
import { computed, ref, watch } from "vue";
import { useCanvas } from "/assets/canvas.js";
import { draw, extent } from "/assets/draw_map.js";
import { stateOf } from "/assets/format.js";
import { drawn, onAir, receivers, remembered, select, selected, setup, tracks, vehicles } from "/assets/store.js";
import { fitted, moved, toPixels, zoomed } from "/assets/view.js";

const STEP_PX = 40;
const TOUCH_PX = 24;

export default {
  setup() {
    const upward = ref(remembered.get("map.upward", "north"));
    const layers = ref({ plan: true, tracks: true, separation: true });
    let view = null;
    let fittedTo = "";

    const direction = () => (upward.value === "north" ? (setup.value?.axis_azimuth_rad ?? Math.PI / 2) : 0);

    const { canvas, redraw } = useCanvas((context, width, height, colours) => {
      const wanted = `${setup.value?.run}|${upward.value}|${width}x${height}`;
      if (!view || fittedTo !== wanted) {
        view = fitted(extent({ setup: setup.value, vehicles: vehicles.value }), width, height, direction());
        fittedTo = wanted;
      }
      draw(context, width, height, view, scene(), colours);
    });

    const scene = () => ({
      setup: setup.value,
      receivers: receivers.value,
      vehicles: vehicles.value,
      onAir: onAir.value,
      selected: selected.value,
      layers: layers.value,
      kindOf: (name) => stateOf(name).kind,
      tracks,
    });

    const middle = () => [canvas.value.clientWidth / 2, canvas.value.clientHeight / 2];
    const change = (next) => {
      view = next;
      redraw();
    };
    const zoom = (factor, about = middle()) => view && change(zoomed(view, factor, about));
    const fit = () => {
      fittedTo = "";
      redraw();
    };
    const turn = () => {
      upward.value = upward.value === "north" ? "formation" : "north";
      remembered.set("map.upward", upward.value);
    };
    const KEYS = {
      ArrowLeft: () => change(moved(view, STEP_PX, 0)),
      ArrowRight: () => change(moved(view, -STEP_PX, 0)),
      ArrowUp: () => change(moved(view, 0, STEP_PX)),
      ArrowDown: () => change(moved(view, 0, -STEP_PX)),
      "+": () => zoom(1.25),
      "=": () => zoom(1.25),
      "-": () => zoom(0.8),
      0: fit,
      n: turn,
    };
    const key = (event) => {
      if (!KEYS[event.key] || event.ctrlKey || event.metaKey || event.altKey || !view) return;
      event.preventDefault();
      KEYS[event.key]();
    };

    const fingers = new Map();
    let dragged = 0;
    const place = (event) => [event.offsetX, event.offsetY];
    const down = (event) => {
      canvas.value.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, place(event));
      dragged = 0;
    };
    const move = (event) => {
      const before = fingers.get(event.pointerId);
      if (!before || !view) return;
      const now = place(event);
      const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
      if (other) {
        const apart = (point) => Math.max(10, Math.hypot(point[0] - other[0], point[1] - other[1]));
        view = zoomed(view, apart(now) / apart(before), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
        view = moved(view, (now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
      } else view = moved(view, now[0] - before[0], now[1] - before[1]);
      fingers.set(event.pointerId, now);
      redraw();
    };
    const up = (event) => {
      if (fingers.delete(event.pointerId) && dragged < 6) pick(place(event));
    };
    const pick = ([x, y]) => {
      if (!view) return;
      let [nearest, least] = [null, TOUCH_PX];
      for (const vehicle of vehicles.value) {
        if (!vehicle.at_m) continue;
        const [atX, atY] = toPixels(view, vehicle.at_m);
        const apart = Math.hypot(atX - x, atY - y);
        if (apart < least) [nearest, least] = [vehicle.name, apart];
      }
      if (nearest || selected.value) select(nearest ?? selected.value);
    };
    const wheel = (event) => zoom(Math.exp(-event.deltaY * 0.0015), place(event));

    watch([drawn, selected, upward, layers, () => setup.value], redraw, { deep: true });
    addEventListener("themechange", redraw);

    const words = computed(() => {
      const placed = receivers.value.filter((receiver) => receiver.state === "PLACED").length;
      const air = [...onAir.value].join(", ") || "nobody";
      return `Formation from above, ${upward.value} up: ${placed} of ${receivers.value.length} placed; on the air: ${air}. `
        + "Arrow keys pan, plus and minus zoom, 0 fits, N turns. The relay table says the same in words.";
    });
    return { canvas, upward, layers, zoom, fit, turn, key, down, move, up, wheel, words };
  },
  template: `
    <section class="panel map-panel" aria-labelledby="map-title">
      <header>
        <h2 id="map-title">Formation</h2>
        <span class="tools">
          <button type="button" @click="turn" :title="'turn the map (N)'">{{ upward === "north" ? "North up" : "Formation up" }}</button>
          <button type="button" @click="zoom(1.25)" aria-label="Zoom in">+</button>
          <button type="button" @click="zoom(0.8)" aria-label="Zoom out">−</button>
          <button type="button" @click="fit" title="show everything (0)">Fit</button>
        </span>
      </header>
      <canvas ref="canvas" class="map" tabindex="0" role="img" :aria-label="words" @keydown="key"
        @pointerdown="down" @pointermove="move" @pointerup="up" @pointercancel="up" @wheel.prevent="wheel"></canvas>
      <footer class="legend">
        <label><input type="checkbox" v-model="layers.plan"> plan</label>
        <label><input type="checkbox" v-model="layers.tracks"> tracks</label>
        <label><input type="checkbox" v-model="layers.separation"> separation</label>
        <span class="key"><i class="k-emitting">▲</i> emitting</span>
        <span class="key"><i>△</i> silent</span>
        <span class="key"><i class="k-moving">➤</i> moving</span>
        <span class="key"><i class="k-waiting">➤</i> waiting</span>
        <span class="key"><i class="k-placed">➤</i> placed</span>
        <span class="key"><i class="k-held">➤</i> held</span>
        <span class="key"><i>◇</i> turn</span>
      </footer>
    </section>`,
};
