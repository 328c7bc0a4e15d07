// The event log, the latest first; filtered by level, vehicle and words.
import { computed, ref } from "vue";
import { number } from "/assets/format.js";
import { events } from "/assets/store.js";

const PAGE = 150;
const RANK = { info: 0, warning: 1, alert: 2 };
const SIGNS = { alert: "■", warning: "▲", info: "·" };

export default {
  setup() {
    const words = ref("");
    const least = ref("info");
    const vehicle = ref("");
    const pages = ref(1);
    const names = computed(() => [...new Set(events.value.map((event) => event.vehicle).filter(Boolean))].sort());
    const found = computed(() => {
      const wanted = words.value.trim().toLowerCase();
      return events.value.filter(
        (event) =>
          RANK[event.level ?? "info"] >= RANK[least.value] &&
          (!vehicle.value || event.vehicle === vehicle.value) &&
          (!wanted || event.text.toLowerCase().includes(wanted)),
      );
    });
    const shown = computed(() => found.value.slice(-PAGE * pages.value).reverse());
    return { events, found, least, names, number, pages, shown, SIGNS, vehicle, words };
  },
  template: `
    <section class="panel event-panel" aria-labelledby="event-title">
      <header><h2 id="event-title">Events</h2><span class="note">{{ found.length }} of {{ events.length }}</span></header>
      <div class="filters">
        <label>Find <input type="search" v-model="words" placeholder="words" data-test="event-words"></label>
        <label>Level <select v-model="least"><option value="info">all</option><option value="warning">warnings</option><option value="alert">alerts</option></select></label>
        <label>Vehicle <select v-model="vehicle"><option value="">all</option><option v-for="name in names" :key="name">{{ name }}</option></select></label>
      </div>
      <div class="scroll" tabindex="0" role="region" aria-labelledby="event-title">
        <p v-if="!shown.length" class="empty">{{ events.length ? "Nothing matches." : "Nothing yet." }}</p>
        <ol class="log" data-test="log">
          <li v-for="event in shown" :key="event.number" :class="event.level ?? 'info'"><time>{{ number(event.elapsed_s) }} s</time><i aria-hidden="true">{{ SIGNS[event.level ?? "info"] }}</i><span><span v-if="(event.level ?? 'info') !== 'info'" class="unseen">{{ event.level }}: </span>{{ event.text }}</span></li>
        </ol>
        <button v-if="found.length > shown.length" type="button" @click="pages++">Older</button>
      </div>
    </section>`,
};
