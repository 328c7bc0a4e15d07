// Health: every vehicle with its link and its sensor, and what they all share.
import { computed, ref } from "vue";
import { age, metres, number, percent } from "/assets/format.js";
import { receiverOf, select, selected, state, taken, vehicles } from "/assets/store.js";

const sum = (counts) => Object.values(counts ?? {}).reduce((total, count) => total + count, 0);

export default {
  setup() {
    const onlyTroubled = ref(false);
    const links = computed(() => state.value?.links ?? []);
    const linkOf = (name) => links.value.find((link) => link.vehicles.split(/[ ,]+/).includes(name));
    const rows = computed(() =>
      vehicles.value.map((vehicle) => {
        const link = linkOf(vehicle.name);
        const bearings = receiverOf(vehicle.name)?.bearings;
        const dropped = sum(bearings?.dropped);
        const worries = {
          link: link && link.state !== "up",
          loss: link?.loss > 0.01,
          age: vehicle.silent_s > 0.5,
          mode: taken.value.has(vehicle.name),
          battery: vehicle.battery_percent !== undefined && vehicle.battery_percent <= 30,
          estimator: vehicle.estimator === "poor",
          sensor: bearings?.received > 0 && dropped / bearings.received > 0.05,
        };
        return { vehicle, link, bearings, dropped, worries, troubled: Object.values(worries).some(Boolean) };
      }),
    );
    const shown = computed(() => (onlyTroubled.value ? rows.value.filter((row) => row.troubled) : rows.value));
    const kinds = (dropped) => Object.entries(dropped ?? {}).filter(([, count]) => count).map(([kind, count]) => `${count} ${kind.replaceAll("_", " ")}`).join(", ");
    const recording = computed(() => state.value?.recording ?? {});
    return { age, kinds, metres, number, onlyTroubled, percent, recording, rows, select, selected, shown, state, taken };
  },
  template: `
    <section class="panel health-panel" aria-labelledby="health-title">
      <header><h2 id="health-title">Health</h2>
        <label class="note"><input type="checkbox" v-model="onlyTroubled"> only what is not well ({{ rows.filter((row) => row.troubled).length }})</label></header>
      <p v-if="!state" class="empty">Nothing is heard yet.</p>
      <ul v-else class="shared">
        <li :class="{bad: state?.bus?.connected === false}"><i aria-hidden="true">{{ state?.bus?.connected === false ? "✕" : "✓" }}</i> bus {{ state?.bus?.connected === false ? "gone" : "connected" }}<template v-if="state?.bus?.strangers">, {{ state.bus.strangers }} reports of strangers</template></li>
        <li :class="{bad: recording.problem || recording.dropped}"><i aria-hidden="true">{{ recording.problem || recording.dropped ? "✕" : "✓" }}</i> recording {{ recording.problem || (recording.dropped ? recording.dropped + " messages missing" : "complete") }}</li>
      </ul>
      <div class="scroll" tabindex="0" role="region" aria-labelledby="health-title">
      <table class="health" role="table">
        <thead role="rowgroup"><tr role="row">
          <th role="columnheader" scope="col">UAV</th><th role="columnheader" scope="col">link</th><th role="columnheader" scope="col" class="n">loss</th><th role="columnheader" scope="col" class="n">age</th>
          <th role="columnheader" scope="col">mode</th><th role="columnheader" scope="col" class="n">battery</th><th role="columnheader" scope="col">EKF</th>
          <th role="columnheader" scope="col" class="n">nearest</th><th role="columnheader" scope="col">bearings</th>
        </tr></thead>
        <tbody role="rowgroup">
          <tr v-for="{vehicle, link, bearings, dropped, worries} in shown" :key="vehicle.name" role="row" :class="{chosen: selected === vehicle.name}">
            <th role="rowheader" scope="row"><button type="button" class="name" :aria-pressed="selected === vehicle.name" @click="select(vehicle.name)">{{ vehicle.name }}</button></th>
            <td role="cell" data-label="link" :class="{bad: worries.link}">{{ link ? link.state : "–" }}</td>
            <td role="cell" data-label="loss" :class="['n', {bad: worries.loss}]">{{ link?.loss === undefined ? "–" : percent(100 * link.loss, 1) }}</td>
            <td role="cell" data-label="age" :class="['n', {bad: worries.age}]">{{ age(vehicle.silent_s) }}</td>
            <td role="cell" data-label="mode" :class="{bad: worries.mode}">{{ taken.has(vehicle.name) ? "PILOT " : "" }}{{ vehicle.mode || "–" }}{{ vehicle.armed ? "" : ", disarmed" }}</td>
            <td role="cell" data-label="battery" :class="['n', {bad: worries.battery}]"><span :title="vehicle.battery_v ? number(vehicle.battery_v) + ' V' : ''">{{ percent(vehicle.battery_percent) }}</span></td>
            <td role="cell" data-label="EKF" :class="{bad: worries.estimator}">{{ vehicle.estimator ?? "unknown" }}</td>
            <td role="cell" data-label="nearest" class="n">{{ vehicle.nearest ? metres(vehicle.nearest_m, 0) + " " + vehicle.nearest : "–" }}</td>
            <td role="cell" data-label="bearings" :class="{bad: worries.sensor}"><template v-if="bearings">{{ bearings.age_s === undefined ? "none yet" : age(bearings.age_s) + " old" }}<span v-if="dropped">, dropped: {{ kinds(bearings.dropped) }}</span></template><template v-else>–</template></td>
          </tr>
        </tbody>
      </table>
      </div>
    </section>`,
};
