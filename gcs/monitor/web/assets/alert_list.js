// What is wrong and what to do, the worst first; one calm line while all is well.
import { computed } from "vue";
import { seconds } from "/assets/format.js";
import { ageS, ended, heardMs, about, socketOpen, stale, state } from "/assets/store.js";

const SIGNS = { alert: "■", warning: "▲", info: "●" };
const ENDS = {
  formed: "✓ Formed: every receiver stands in its slot.",
  completed: "✓ Completed: every stage is done.",
  aborted: "✕ Aborted: the run has ended before it formed.",
  failed: "✕ Failed: a vehicle could not be brought up.",
};
const WORDS = { alert: "Alert", warning: "Warning", info: "Note" };

export default {
  setup() {
    const ours = computed(() => {
      if (ended.value) return [];
      if (!socketOpen.value)
        return [{ level: "alert", subject: "this page", text: "the dashboard does not answer: what is shown is old",
          way_out: "tried again by itself; the flight does not depend on it: use bearing-relay monitor or control meanwhile" }];
      if (!heardMs.value)
        return [{ level: "info", subject: "run", text: "no run is heard of yet", way_out: about.problem ?? "start one with bearing-relay fly or demo" }];
      if (stale.value)
        return [{ level: "alert", subject: "service", text: `nothing heard for ${seconds(ageS.value)}: what is shown is old`,
          way_out: `${about.problem ?? "check that the service runs"}; without it each vehicle holds by its own time-out` }];
      return [];
    });
    const all = computed(() => [...ours.value, ...(state.value?.alerts ?? [])]);
    const outcome = computed(() => (ended.value ? state.value.phase : null));
    // whoever can command here need not type it elsewhere
    const here = (wayOut) => (about.role === "COMMAND" ? wayOut.replaceAll("bearing-relay control ", "") : wayOut);
    return { all, here, outcome, ENDS, SIGNS, WORDS };
  },
  template: `
    <section class="alerts" aria-labelledby="alerts-title" :data-worst="all[0]?.level ?? 'none'">
      <h2 id="alerts-title" class="unseen">Alerts</h2>
      <ul aria-live="polite" v-if="all.length">
        <li v-for="alert in all" :key="alert.subject + alert.text.replace(/[0-9.]+/g, '')" :class="alert.level">
          <span class="sign" aria-hidden="true">{{ SIGNS[alert.level] }}</span>
          <span class="word">{{ WORDS[alert.level] }}</span>
          <span class="what"><strong>{{ alert.subject }}</strong> {{ alert.text }}</span>
          <span v-if="alert.way_out" class="way-out">→ {{ here(alert.way_out) }}</span>
        </li>
      </ul>
      <p v-else-if="outcome" :class="['calm', outcome]">{{ ENDS[outcome] }}</p>
      <p v-else class="calm">✓ All well: no alerts.</p>
    </section>`,
};
