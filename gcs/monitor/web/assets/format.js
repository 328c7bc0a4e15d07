// Numbers as people read them: degrees and metres, always with their unit.
const NOTHING = "–";
const known = (value) => value !== undefined && value !== null && Number.isFinite(value);

export const number = (value, digits = 1) => (known(value) ? value.toFixed(digits).replace("-", "−") : NOTHING);
export const metres = (value, digits = 1) => (known(value) ? `${number(value, digits)} m` : NOTHING);
export const signedMetres = (value) => (known(value) ? `${value > 0 ? "+" : ""}${number(value)} m` : NOTHING);
export const speed = (value) => (known(value) ? `${number(value)} m/s` : NOTHING);
export const inDegrees = (rad) => (rad * 180) / Math.PI;
export const degrees = (rad, digits = 2) => (known(rad) ? `${number(inDegrees(rad), digits)}°` : NOTHING);
export const rate = (radps) => (known(radps) ? `${number(inDegrees(radps), 2)} °/s` : NOTHING);
export const percent = (value, digits = 0) => (known(value) ? `${number(value, digits)} %` : NOTHING);
export const seconds = (value) => (known(value) ? `${number(value)} s` : NOTHING);
export const age = (value) => (known(value) ? (value < 1 ? `${Math.round(value * 1000)} ms` : `${number(value)} s`) : NOTHING);

// how a leg lies to its guide
export const course = ({ direction, guide }) => `${direction === "away" ? "away from" : direction} ${guide}`;

// 75 -> "1:15"
export function clock(value) {
  if (!known(value)) return NOTHING;
  const whole = Math.max(0, Math.round(value));
  const minutes = Math.floor(whole / 60);
  const rest = String(whole % 60).padStart(2, "0");
  if (minutes < 60) return `${minutes}:${rest}`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${rest}`;
}

// what each state is called on the screen, its sign and its class: never told by colour alone
export const STATES = {
  WAITING: { sign: "○", kind: "waiting" },
  LOCATING: { sign: "⌖", kind: "moving" },
  LEG_1: { sign: "①", kind: "moving" },
  LEG_2: { sign: "②", kind: "moving" },
  VERIFYING: { sign: "?", kind: "moving" },
  TRIMMING: { sign: "≈", kind: "moving" },
  PLACED: { sign: "✓", kind: "placed" },
  HELD: { sign: "‖", kind: "held" },
  PILOT: { sign: "✋︎", kind: "pilot" },
  FAILED: { sign: "✕", kind: "failed" },
};
export const stateOf = (name) => STATES[name] ?? { sign: "•", kind: "waiting" };
