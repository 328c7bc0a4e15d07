// A canvas as large as its place, sharp on every screen, drawn no more than once a frame.
import { nextTick, onBeforeUnmount, onMounted, ref } from "vue";

// Return {canvas, redraw}: give `canvas` as the ref of a <canvas>; `paint(context, width, height, colours)` draws it.
export function useCanvas(paint) {
  const canvas = ref(null);
  let asked = false;
  let observer = null;

  function now() {
    asked = false;
    const element = canvas.value;
    if (!element) return;
    const { clientWidth: width, clientHeight: height } = element;
    const ratio = window.devicePixelRatio || 1;
    if (!width || !height) return;
    if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
      element.width = Math.round(width * ratio);
      element.height = Math.round(height * ratio);
    }
    const context = element.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    paint(context, width, height, colours(element));
  }

  function redraw() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(now);
  }

  onMounted(() =>
    nextTick(() => {
      observer = new ResizeObserver(redraw);
      observer.observe(canvas.value);
      redraw();
    }),
  );
  onBeforeUnmount(() => observer?.disconnect());
  return { canvas, redraw };
}

const NAMES = [
  ..."ink paper muted grid plan slot track trail sight fence select alert".split(" "),
  ..."waiting moving placed held pilot failed emitting band".split(" "),
];
const read = { theme: null, colours: null };

function colours(element) {
  const theme = document.documentElement.dataset.theme;
  if (read.theme !== theme || !read.colours) {
    const style = getComputedStyle(element);
    read.theme = theme;
    read.colours = Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  return read.colours;
}
