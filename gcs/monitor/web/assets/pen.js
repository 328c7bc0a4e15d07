// Draws lines, signs and words at points of the formation frame; words keep off each other.
import { toPixels } from "/assets/view.js";

const WHOLE_TURN = 2 * Math.PI;

const within = (a, b) => a[0] >= b[0] && a[1] >= b[1] && a[2] <= b[2] && a[3] <= b[3];
const overlap = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

export class Pen {
  constructor(context, view, colours, whole) {
    Object.assign(this, { context, view, colours, whole, taken: [] });
  }

  at(point) {
    return toPixels(this.view, point);
  }

  line(points, colour, width = 1.5, dash = [], closed = false) {
    if (points.length < 2) return;
    const { context } = this;
    context.beginPath();
    points.forEach((point, index) => {
      const [x, y] = this.at(point);
      if (index) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    if (closed) context.closePath();
    this.stroke(colour, width, dash);
  }

  stroke(colour, width = 1.5, dash = []) {
    const { context } = this;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  ring([x, y], radius, colour, width = 1.5, dash = []) {
    this.context.beginPath();
    this.context.arc(x, y, radius, 0, WHOLE_TURN);
    this.stroke(colour, width, dash);
  }

  disc([x, y], radius, colour) {
    this.context.beginPath();
    this.context.arc(x, y, radius, 0, WHOLE_TURN);
    this.context.fillStyle = colour;
    this.context.fill();
  }

  text(words, [x, y], { colour = this.colours.ink, size = 13, weight = 600, align = "left" } = {}) {
    const { context } = this;
    context.font = `${weight} ${size}px system-ui, sans-serif`;
    context.textAlign = align;
    context.textBaseline = "middle";
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeStyle = this.colours.paper;
    context.strokeText(words, x, y);
    context.fillStyle = colour;
    context.fillText(words, x, y);
  }

  // words beside a sign, on the first side that is free; where none is, only what must be read is written
  label(words, [x, y], { size = 13, apart = 10, must = false, ...rest } = {}) {
    this.context.font = `600 ${size}px system-ui, sans-serif`;
    const width = this.context.measureText(words).width;
    const half = size / 2;
    const sides = [
      [x + apart, y - apart], [x + apart, y + apart], [x - apart - width, y - apart], [x - apart - width, y + apart],
      [x - width / 2, y - apart - half - 2], [x - width / 2, y + apart + half + 2],
    ];
    const box = ([left, middle]) => [left - 1, middle - half, left + width + 1, middle + half];
    const free = sides.find((side) => within(box(side), this.whole) && !this.taken.some((other) => overlap(box(side), other)));
    const chosen = free ?? (must ? sides[0] : null);
    if (!chosen) return;
    this.taken.push(box(chosen));
    this.text(words, chosen, { size, ...rest });
  }

  // words out from a sign in a direction of the canvas, as near as there is room
  labelAlong(words, [x, y], direction, { size = 13, ...rest } = {}) {
    this.context.font = `600 ${size}px system-ui, sans-serif`;
    const half = this.context.measureText(words).width / 2 + 1;
    const at = (radius) => [x + radius * Math.cos(direction), y + radius * Math.sin(direction)];
    const box = ([middle, level]) => [middle - half, level - size / 2, middle + half, level + size / 2];
    const radius = [44, 60, 76, 92].find((one) => !this.taken.some((other) => overlap(box(at(one)), other))) ?? 44;
    this.taken.push(box(at(radius)));
    this.text(words, at(radius), { size, align: "center", ...rest });
  }
}
