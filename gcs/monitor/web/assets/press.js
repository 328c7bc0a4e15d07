// A button that acts only when it is kept pressed, by finger, mouse or keyboard; a short press asks for the word instead.
import { onBeforeUnmount, ref } from "vue";

const TICK_MS = 30;
const STALL_MS = 200;
const SLIP_PX = 30;

export const PressButton = {
  props: { word: String, label: String, holdMs: { type: Number, default: 1000 }, disabled: Boolean, tone: String, about: String },
  emits: ["done"],
  setup(props, { emit }) {
    const share = ref(0);
    const asking = ref(false);
    const typed = ref("");
    const dialog = ref(null);
    const wrong = ref(false);
    let began = null; // the event; what counts is when it was made, however late it is looked at
    let timer = null;
    let lookedMs = 0;

    const end = () => {
      clearInterval(timer);
      [timer, began, share.value] = [null, null, 0];
    };
    const begin = (event) => {
      if (props.disabled || timer || (event.button !== undefined && event.button !== 0)) return;
      began = event;
      if (event.pointerId !== undefined) event.target.setPointerCapture(event.pointerId); // the page may move under the finger
      lookedMs = performance.now();
      timer = setInterval(tick, TICK_MS);
    };
    const tick = () => {
      const nowMs = performance.now();
      const stalled = nowMs - lookedMs > STALL_MS; // the release may be waiting to be looked at
      lookedMs = nowMs;
      if (!stalled) grow(nowMs);
    };
    const grow = (nowMs) => {
      share.value = Math.min(1, (nowMs - began.timeStamp) / props.holdMs);
      if (share.value < 1) return;
      end();
      emit("done");
    };
    const move = (event) => {
      if (timer && Math.hypot(event.clientX - began.clientX, event.clientY - began.clientY) > SLIP_PX) end();
    };
    const release = (event) => {
      if (timer) grow(event.timeStamp);
      if (!timer) return;
      end();
      ask();
    };
    const keydown = (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      if (!event.repeat) begin(event);
    };
    const keyup = (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      release(event);
    };
    // assistive technology clicks without pressing
    const click = (event) => event.detail === 0 && !props.disabled && !timer && !asking.value && ask();
    const ask = () => {
      [asking.value, typed.value, wrong.value] = [true, "", false];
      dialog.value.showModal();
    };
    const close = () => {
      asking.value = false;
      dialog.value.close();
    };
    const confirm = () => {
      wrong.value = typed.value.trim().toLowerCase() !== props.word;
      if (wrong.value) return;
      close();
      emit("done");
    };
    onBeforeUnmount(end);
    return { share, typed, wrong, dialog, begin, move, release, end, keydown, keyup, click, close, confirm };
  },
  template: `
    <button type="button" :class="['press', tone]" :disabled="disabled" :style="{'--share': share}"
      :aria-label="label + ': keep pressed ' + holdMs / 1000 + ' s' + (about ? ', ' + about : '')" :data-verb="word"
      @pointerdown="begin" @pointermove="move" @pointerup="release" @pointercancel="end" @contextmenu.prevent
      @keydown="keydown" @keyup="keyup" @blur="end" @click="click"><span>{{ label }}</span></button>
    <dialog ref="dialog" class="confirm" :aria-label="label" @cancel="close">
      <form @submit.prevent="confirm">
        <p><strong>{{ label }}</strong>: keep the button pressed for {{ holdMs / 1000 }} s, or type <kbd>{{ word }}</kbd> here.</p>
        <p v-if="about">{{ about }}</p>
        <label>The word <input v-model="typed" autocomplete="off" autocapitalize="off" spellcheck="false" autofocus></label>
        <p v-if="wrong" class="wrong" role="alert">That is not “{{ word }}”.</p>
        <p class="buttons"><button type="submit" class="act">{{ label }}</button><button type="button" @click="close">Cancel</button></p>
      </form>
    </dialog>`,
};
