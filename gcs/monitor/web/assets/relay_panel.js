// The relay: a row per receiver with its state, what it flies and how far it still is, and its time line beside it.
import { computed, ref } from "vue";
import { clock, course, metres, stateOf } from "/assets/format.js";
import { ended, onAir, receivers, select, selected, setup, spans, state } from "/assets/store.js";

const SHORT = { LOCATING: "loc", LEG_1: "1", LEG_2: "2", VERIFYING: "ver", TRIMMING: "trim", PLACED: "✓", HELD: "‖", PILOT: "✋︎", FAILED: "✕" };

export default {
  setup() {
    // the states of each receiver in order: [{state, from, to}], s since the run began
    const lines = computed(() => new Map([...spans.value].map(([name, entered]) => [name, inOrder(entered)])));
    const beganS = computed(() => {
      const begun = [...lines.value.values()].flat().filter((span) => span.state !== "WAITING");
      return Math.min(...begun.map((span) => span.from), state.value?.elapsed_s ?? 0);
    });
    const endS = computed(() => {
      const planned = beganS.value + (setup.value?.predicted_s ?? 60);
      const now = state.value?.elapsed_s ?? 0;
      return Math.max(planned, now + (state.value?.to_go_s ?? 0), beganS.value + 10) * 1.02;
    });
    const share = (at) => Math.min(100, Math.max(0, (100 * (at - beganS.value)) / (endS.value - beganS.value)));
    const between = (from, to) => ({ left: `${share(from)}%`, width: `${Math.max(0.4, share(to) - share(from))}%` });
    const now = computed(() => state.value?.elapsed_s ?? 0);
    const bars = (name) =>
      (lines.value.get(name) ?? [])
        .filter((span) => span.state !== "WAITING")
        .map((span) => ({ ...span, ...stateOf(span.state), style: between(span.from, span.to ?? now.value), short: SHORT[span.state] ?? "" }));
    const planned = computed(() => {
      const plans = new Map();
      for (const route of setup.value?.routes ?? [])
        plans.set(route.receiver, between(beganS.value + route.begins_s, beganS.value + route.ends_s));
      return plans;
    });
    const ticks = computed(() => {
      const whole = endS.value - beganS.value;
      const step = [5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600].find((one) => whole / one <= 3) ?? 7200;
      return Array.from({ length: Math.floor(whole / step) + 1 }, (_, index) => ({ words: clock(index * step), left: `${share(beganS.value + index * step)}%` }));
    });
    const doing = (receiver) => {
      if (receiver.leg) return `${course(receiver.leg)} (${receiver.leg.number}/${Math.max(receiver.legs ?? 0, receiver.leg.number)})`;
      return receiver.reason ?? "";
    };
    const nowLeft = computed(() => `${share(now.value)}%`);
    const onlyOnTheirWay = ref(false);
    const sorted = computed(() =>
      [...receivers.value].filter((one) => !onlyOnTheirWay.value || one.state !== "PLACED").sort((a, b) => a.wave - b.wave),
    );
    return { bars, clock, doing, ended, metres, nowLeft, onAir, onlyOnTheirWay, planned, receivers, select, selected, sorted, stateOf, state, ticks };
  },
  template: `
    <section class="panel relay-panel" aria-labelledby="relay-title">
      <header><h2 id="relay-title">Relay</h2><span class="note" v-if="!ended">{{ clock(state?.to_go_s) }} to go</span>
        <label class="note"><input type="checkbox" v-model="onlyOnTheirWay"> without the placed</label></header>
      <p v-if="!sorted.length" class="empty">{{ receivers.length ? "All are placed." : "No receivers yet." }}</p>
      <div v-else class="scroll" tabindex="0" role="region" aria-labelledby="relay-title">
      <table class="relay" role="table">
        <thead role="rowgroup"><tr role="row">
          <th role="columnheader" scope="col">UAV → slot</th><th role="columnheader" scope="col" class="n">wave</th>
          <th role="columnheader" scope="col">state</th><th role="columnheader" scope="col" class="doing">doing</th>
          <th role="columnheader" scope="colgroup" class="n" colspan="2">to go</th>
          <th role="columnheader" scope="col" class="gantt"><span class="unseen">time line</span>
            <span class="ticks" aria-hidden="true"><i v-for="tick in ticks" :key="tick.words" :style="{left: tick.left}">{{ tick.words }}</i></span></th>
        </tr></thead>
        <tbody role="rowgroup">
          <tr v-for="receiver in sorted" :key="receiver.name" role="row" :class="{chosen: selected === receiver.name}" :data-receiver="receiver.name" :data-state="receiver.state">
            <th role="rowheader" scope="row"><button type="button" class="name" :aria-pressed="selected === receiver.name" @click="select(receiver.name)">{{ receiver.name }}</button> → {{ receiver.slot }}<span v-if="onAir.has(receiver.name)" class="air" title="on the air"> ◉<span class="unseen"> on the air</span></span></th>
            <td role="cell" class="n">{{ receiver.wave }}</td>
            <td role="cell"><span :class="['state', stateOf(receiver.state).kind]"><i aria-hidden="true">{{ stateOf(receiver.state).sign }}</i> {{ receiver.state.replace("_", " ") }}</span></td>
            <td role="cell" class="doing">{{ doing(receiver) }}</td>
            <td role="cell" class="n">{{ receiver.leg ? metres(receiver.leg.remaining_m) : "" }}</td>
            <td role="cell" class="n">{{ ended || receiver.state === "PLACED" ? "" : clock(receiver.to_go_s) }}</td>
            <td role="cell" class="gantt"><div class="lane" aria-hidden="true">
              <span class="planned" :style="planned.get(receiver.name)"></span>
              <span v-for="bar in bars(receiver.name)" :key="bar.from" :class="['bar', bar.kind]" :style="bar.style" :title="bar.state">{{ bar.short }}</span>
              <span class="now" :style="{left: nowLeft}"></span>
            </div></td>
          </tr>
        </tbody>
      </table>
      </div>
    </section>`,
};

function inOrder(entered) {
  const found = [];
  for (const [from, name] of entered) {
    if (found.at(-1)?.state === name) continue;
    if (found.length) found.at(-1).to = from;
    found.push({ state: name, from, to: null });
  }
  return found;
}
