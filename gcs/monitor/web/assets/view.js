// The map's view: formation frame (metres, y to the left of x) to pixels, turned, zoomed and moved. Pure.

// Return the view in which the points fill a width x height picture. `upward` is the polar direction drawn upwards, rad.
export function fitted(points, width, height, upward, margin = 28) {
  const turned = { cos: Math.cos(Math.PI / 2 - upward), sin: Math.sin(Math.PI / 2 - upward) };
  const seen = points.map((point) => turn(point, turned));
  const xs = seen.map((point) => point[0]);
  const ys = seen.map((point) => point[1]);
  const [left, right] = xs.length ? [Math.min(...xs), Math.max(...xs)] : [-50, 50];
  const [bottom, top] = ys.length ? [Math.min(...ys), Math.max(...ys)] : [-50, 50];
  const scale = Math.min(
    Math.max(width - 2 * margin, 50) / Math.max(right - left, 10),
    Math.max(height - 2 * margin, 50) / Math.max(top - bottom, 10),
  );
  return {
    turned,
    upward,
    scale,
    x: width / 2 - (scale * (left + right)) / 2,
    y: height / 2 + (scale * (bottom + top)) / 2,
  };
}

const turn = ([x, y], { cos, sin }) => [x * cos - y * sin, x * sin + y * cos];

// Return where a point of the formation frame is drawn, px.
export function toPixels(view, point) {
  const [x, y] = turn(point, view.turned);
  return [view.x + view.scale * x, view.y - view.scale * y];
}

// Return the angle on the canvas (clockwise from the right) of a polar direction of the formation frame, rad.
export const onCanvas = (view, direction) => -(direction + Math.PI / 2 - view.upward);

// Return the view zoomed about a pixel, between 0.2 and 200 px/m.
export function zoomed(view, factor, [x, y]) {
  const scale = Math.min(200, Math.max(0.2, view.scale * factor));
  const by = scale / view.scale;
  return { ...view, scale, x: x + (view.x - x) * by, y: y + (view.y - y) * by };
}

export const moved = (view, dx, dy) => ({ ...view, x: view.x + dx, y: view.y + dy });

// Return a round length that is drawn no longer than `most` px, m.
export function roundLength(view, most) {
  const longest = most / view.scale;
  const power = 10 ** Math.floor(Math.log10(longest));
  return power * (longest >= 5 * power ? 5 : longest >= 2 * power ? 2 : 1);
}
