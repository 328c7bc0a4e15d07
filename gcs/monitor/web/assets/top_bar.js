// The head of the page: which run, how far, whether what is shown is fresh, and the one button that stops everything.
import { computed, nextTick, onMounted, ref, watchEffect } from "vue";
import { ask } from "/assets/answers.js";
import { detach } from "/assets/detach.js";
import { clock, seconds } from "/assets/format.js";
import { PressButton } from "/assets/press.js";
import {
  ageS, ended, onAir, receivers, remembered, about, setup, signOut, socketOpen, stale, start, state,
} from "/assets/store.js";

const THEMES = ["auto", "light", "dark"];
const SIGNS = { auto: ["◐", "Auto"], light: ["☀︎", "Light"], dark: ["☾", "Dark"] };

export default {
  components: { PressButton },
  setup() {
    start();
    onMounted(() => nextTick(detach));
    const theme = ref(remembered.get("theme", "auto"));
    const prefersDark = matchMedia("(prefers-color-scheme: dark)");
    const dark = ref(prefersDark.matches);
    prefersDark.addEventListener("change", () => (dark.value = prefersDark.matches));
    watchEffect(() => {
      const shown = theme.value === "auto" ? (dark.value ? "dark" : "light") : theme.value;
      document.documentElement.dataset.theme = shown;
      dispatchEvent(new Event("themechange"));
    });
    const nextTheme = () => {
      theme.value = THEMES[(THEMES.indexOf(theme.value) + 1) % THEMES.length];
      remembered.set("theme", theme.value);
    };
    const placed = computed(() => receivers.value.filter((receiver) => receiver.state === "PLACED").length);
    const fresh = computed(() => {
      if (ended.value) return { kind: "over", words: "ended" };
      if (!socketOpen.value) return { kind: "old", words: "dashboard gone" };
      if (!state.value) return { kind: "old", words: "no run yet" };
      if (stale.value) return { kind: "old", words: `old: ${seconds(ageS.value)}` };
      return { kind: "live", words: "live" };
    });
    const phase = computed(() => (state.value?.held != null && !ended.value ? "held" : (state.value?.phase ?? "no run")));
    watchEffect(() => {
      const alerts = (state.value?.alerts ?? []).filter((alert) => alert.level === "alert").length;
      const sign = fresh.value.kind === "old" ? "? " : alerts ? `■${alerts} ` : "";
      document.title = `${sign}${phase.value} ${placed.value}/${receivers.value.length} – ${setup.value?.playbook ?? "bearing-relay"}`;
    });
    watchEffect(() => document.documentElement.toggleAttribute("data-old", fresh.value.kind === "old"));
    return { ask, clock, ended, fresh, nextTheme, onAir, phase, placed, receivers, about, setup, signOut, SIGNS, state, theme };
  },
  template: `
    <header class="top">
      <div class="run">
        <h1>{{ setup?.playbook ?? "bearing-relay" }}</h1>
        <span class="phase" :data-phase="phase" data-test="phase">{{ phase }}</span>
        <span :class="['fresh', fresh.kind]" role="status" data-test="fresh">{{ fresh.words }}</span>
      </div>
      <dl class="figures">
        <div><dt>elapsed</dt><dd>{{ clock(state?.elapsed_s) }}</dd></div>
        <div><dt>to go</dt><dd>{{ ended ? "–" : clock(state?.to_go_s) }}</dd></div>
        <div><dt>placed</dt><dd data-test="placed">{{ placed }} / {{ receivers.length }}</dd></div>
        <div class="wide"><dt>on the air</dt><dd>{{ onAir.size > 6 ? onAir.size + " transmitters" : [...onAir].join(" ") || "nobody" }}</dd></div>
      </dl>
      <div class="doings">
        <a v-if="about.report && ended" class="button" :href="about.report" target="_blank" rel="noopener" data-test="report">Report</a>
        <button type="button" class="quiet" @click="nextTheme" :aria-label="'Colours: ' + theme">{{ SIGNS[theme][0] }}<span class="word">&nbsp;{{ SIGNS[theme][1] }}</span></button>
        <button v-if="about.signed_in" type="button" class="quiet" @click="signOut">Sign out</button>
        <a v-else-if="about.commanding" class="button quiet" href="/login" data-test="sign-in">Sign in</a>
      </div>
      <press-button v-if="about.role === 'COMMAND' && !ended" class="stop" word="hold" label="HOLD ALL" :hold-ms="400" tone="stop"
        about="stops every vehicle in flight; resume goes on" @done="ask('hold')"></press-button>
    </header>`,
};
