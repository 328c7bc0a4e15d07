// The operator's words to the relay, each kept pressed or typed, and what the relay answered.
import { computed, ref, watch } from "vue";
import { answers, ask } from "/assets/answers.js";
import { PressButton } from "/assets/press.js";
import { ended, receivers, selected, about, state, taken, vehicles } from "/assets/store.js";

export default {
  components: { PressButton },
  setup() {
    const whom = ref("");
    const names = computed(() => [...new Set([...vehicles.value, ...receivers.value].map((one) => one.name))]);
    watch(selected, (name) => name && (whom.value = name));
    watch(taken, (now) => !whom.value && now.size && (whom.value = [...now][0]));
    const off = computed(() => {
      if (!about.commanding) return "Commanding is off: no token for it was set where this dashboard was started.";
      if (about.role !== "COMMAND") return "You may look. To command, sign in with the command token.";
      return ended.value ? "The run has ended: there is nothing to command." : null;
    });
    const may = computed(() => off.value === null);
    return { answers, ask, may, names, off, about, state, taken, whom };
  },
  template: `
    <section class="panel command-panel" aria-labelledby="command-title">
      <header><h2 id="command-title">Commands</h2><span class="note" v-if="may">keep pressed to act</span></header>
      <p v-if="off" class="empty" data-test="command-off">{{ off }} <a v-if="about.commanding && about.role !== 'COMMAND'" href="/login">Sign in</a></p>
      <template v-else>
        <p v-if="state?.asked" class="waiting-words"><strong>The run asks:</strong> {{ state.asked }}: resume, or abort</p>
        <p v-else-if="state?.waiting" class="waiting-words"><strong>The relay waits for you:</strong> {{ (state.ways_out ?? []).join(", or ").replaceAll("bearing-relay control ", "") }}</p>
        <div class="commands">
          <press-button word="hold" label="Hold all" :hold-ms="400" tone="stop" about="stops every vehicle in flight; resume goes on" @done="ask('hold')"></press-button>
          <press-button word="resume" label="Resume" :hold-ms="800" tone="go" about="locates every held vehicle anew and goes on" @done="ask('resume')"></press-button>
          <press-button word="abort" label="Abort" :hold-ms="1500" tone="careful" about="stops every vehicle and ends the run" @done="ask('abort')"></press-button>
        </div>
        <div class="commands">
          <label class="whom">Vehicle <select v-model="whom"><option value="">choose …</option><option v-for="name in names" :key="name" :value="name">{{ name }}{{ taken.has(name) ? " (PILOT)" : "" }}</option></select></label>
          <press-button word="release" :label="'Release ' + (whom || '…')" :hold-ms="1000" tone="go" :disabled="!whom" about="takes it back from its pilot" @done="ask('release', whom)"></press-button>
          <press-button word="skip" :label="'Skip ' + (whom || '…')" :hold-ms="1500" tone="careful" :disabled="!whom" about="gives it up; it hovers" @done="ask('skip', whom)"></press-button>
        </div>
      </template>
      <ol v-if="answers.length" class="answers" aria-live="polite" data-test="answers">
        <li v-for="answer in answers" :key="+answer.at" :class="answer.ok === null ? '' : answer.ok ? 'done' : 'refused'">
          <i aria-hidden="true">{{ answer.ok === null ? "…" : answer.ok ? "✓" : "✕" }}</i> <b>{{ answer.said }}</b> {{ answer.ok === false ? "refused: " : "" }}{{ answer.message }}
        </li>
      </ol>
    </section>`,
};
