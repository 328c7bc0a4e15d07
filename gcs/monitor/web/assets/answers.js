// What was asked of the relay and what it answered: the latest few, for every panel that asks.
import { shallowRef } from "vue";
import { command } from "/assets/store.js";

const KEPT = 5;

export const answers = shallowRef([]); // [{said, ok, message, at}], the latest first; ok is null while it is under way

export async function ask(verb, vehicle) {
  const said = { said: vehicle ? `${verb} ${vehicle}` : verb, ok: null, message: "asked …", at: new Date() };
  answers.value = [said, ...answers.value].slice(0, KEPT);
  const { ok, message } = await command(verb, vehicle);
  answers.value = answers.value.map((one) => (one === said ? { ...said, ok, message } : one));
}
