// What an operator wishes: read back with its effect, obeyed once confirmed, ended.

import { fill } from "./panels.js";
import { clock } from "./words.js";

const $ = (id) => document.getElementById(id);
const CLASSES = ["person", "forklift", "vehicle"]; // Those that the project's detectors find.

export class Wishes {
  // `ask(what, request)` sends a control and returns its reply; it throws what the swarm refuses.
  constructor(stream, ask) {
    this.stream = stream;
    this.ask = ask;
    this.places = []; // Of the site: {name, polygon}.
    this.words = {}; // What people call them besides.
    this.read = null; // What was read back and not confirmed yet.
    $("wish").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#readWords();
    });
    $("wish-fields").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#tell(() => this.#try({ intent: fields(), said: "" }));
    });
    $("wish-confirm").addEventListener("click", () => this.#confirm());
    $("wish-forget").addEventListener("click", () => this.#show(null));
  }

  update() {
    const intents = this.stream.get("decision")?.intents ?? [];
    fill($("wishes"), intents, (one) => this.#line(one));
  }

  // The places that a site has names for.
  name({ places, words }) {
    this.places = places;
    this.words = words;
    const chosen = $("wish-place").value;
    const names = [...new Set(places.map((place) => place.name))];
    $("wish-place").replaceChildren(new Option("no place", ""), ...names.map((name) => new Option(name, name)));
    if (names.includes(chosen)) $("wish-place").value = chosen;
  }

  #line({ number, operator, since, says, bound }) {
    const line = document.createElement("li");
    const did = bound.length ? ` (${bound.join("; ")})` : "";
    line.textContent = `${number}, of ${operator || "unknown"} since ${clock(since)}: ${says}${did} `;
    const end = Object.assign(document.createElement("button"), { type: "button", textContent: "End" });
    end.setAttribute("aria-label", `End wish ${number}`);
    end.addEventListener("click", () => this.#tell(async () => {
      await this.ask("ego", { wish: {}, act: "withdraw", number });
      return `wish ${number} has ended`;
    }));
    line.append(end);
    return line;
  }

  #readWords() {
    const wish = $("wish-text").value.trim();
    if (!wish) return;
    this.#tell(async () => {
      const robots = this.stream.all("robot/").map((robot) => robot.robot);
      const site = { robots, places: [...new Set(this.places.map((place) => place.name))], classes: CLASSES, words: this.words };
      const reply = await this.ask("wish", { wish, site, now: local(new Date()) }).catch((error) => {
        $("wish-by-fields").open = true;
        throw Object.assign(error, { message: `${error.message}; wishes in force stay, and the fields below say the same` });
      });
      return this.#try({ intent: reply.understood, said: wish });
    });
  }

  // Reads an intent back; nothing is in force before it is confirmed.
  async #try({ intent, said }) {
    this.#show(null);
    const request = { wish: {}, intent, said, places: this.places.filter(({ name }) => intent.focus?.some(({ place }) => place === name)) };
    const unclear = (intent.unclear ?? []).map((words) => `not clear: “${words}”`);
    const reply = await this.ask("ego", { ...request, act: "try" }).catch((error) => {
      throw Object.assign(error, { message: [error.message, ...unclear].join("; ") });
    });
    this.#show({ request, nobody: reply.effect?.nobody, says: [...reply.says, ...unclear] });
    return "read it, then confirm";
  }

  #show(read) {
    this.read = read;
    fill($("wish-says"), read?.says ?? [], (words) => Object.assign(document.createElement("li"), { textContent: words }));
    $("wish-answer").hidden = !read;
  }

  #confirm() {
    const { request, nobody } = this.read;
    if (nobody && !window.confirm("It leaves nobody to ask: the ego goes on alone. Obey it all the same?")) return;
    this.#tell(async () => {
      const reply = await this.ask("ego", { ...request, act: nobody ? "confirm-nobody" : "confirm" });
      this.#show(null);
      $("wish-text").value = "";
      return `${reply.ego} obeys wish ${reply.number}`;
    });
  }

  async #tell(action) {
    $("wish-result").textContent = "asking …";
    const words = await action().catch((error) => `not done: ${error.message}`);
    $("wish-result").textContent = `${clock(Date.now() / 1000)} ${words}`;
  }
}

// The intent of the fields.
function fields() {
  const robots = $("wish-exclude").value.split(",").map((name) => name.trim()).filter(Boolean);
  const number = (id, scale) => ($(id).value === "" ? null : Number($(id).value) * scale);
  const minutes = number("wish-minutes", 60_000);
  const place = $("wish-place").value;
  return {
    exclude: robots,
    focus: place ? [{ place, weight: $("wish-weight").value }] : [],
    q_min: number("wish-q-min", 1),
    link_share: number("wish-share", 0.01),
    save: $("wish-save").value || null,
    until: minutes === null ? null : new Date(Date.now() + minutes).toISOString(),
  };
}

// The time in this browser's own zone: "until six" means six o'clock here.
function local(date) {
  const minutes = -date.getTimezoneOffset(), two = (value) => String(Math.trunc(Math.abs(value))).padStart(2, "0");
  const there = new Date(date.getTime() + 60_000 * minutes).toISOString().slice(0, 19);
  return `${there}${minutes < 0 ? "-" : "+"}${two(minutes / 60)}:${two(minutes % 60)}`;
}
