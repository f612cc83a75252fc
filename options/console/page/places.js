// Names of the site's places: drawn on the floor, changed, taken away; all that read the site file
// know them from then on.

import { fill } from "./panels.js";
import { clock } from "./words.js";

const $ = (id) => document.getElementById(id);
const MOST_CORNERS = 64;

export class Places {
  // `ask(what, request)` sends a change and returns the places then; `changed(site)` hears of them.
  constructor(map, ask, changed) {
    this.map = map;
    this.ask = ask;
    this.changed = changed;
    this.site = { places: [], words: {}, drawable: false, trouble: "" };
    this.editing = null; // {act, name} while the form is open.
    map.onPoint = (x, y, first) => this.#point(x, y, first);
    $("place-draw").addEventListener("click", () => this.#open("draw"));
    $("place-cancel").addEventListener("click", () => this.#close());
    $("place-undo").addEventListener("click", () => this.#outline(this.map.outline.corners.slice(0, -1)));
    $("place-corners").addEventListener("change", () => this.#outline(corners($("place-corners").value)));
    $("place").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#tell(() => this.#save());
    });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.editing) this.#close();
    });
  }

  // What the console says of the site: `places`, `words`, `drawable`, `trouble`.
  show(site) {
    this.site = site;
    this.map.floor.places = site.places;
    this.map.changed();
    const names = [...new Set(site.places.map((place) => place.name))];
    $("places-count").textContent = names.length === 1 ? "1 place" : `${names.length} places`;
    fill($("places"), names.map((name) => [name, site.words[name] ?? []]), (row) => this.#line(...row));
    $("place-draw").disabled = !site.drawable || Boolean(site.trouble);
    if (site.trouble) $("place-result").textContent = site.trouble;
    this.changed(site);
  }

  #line(name, words) {
    const line = document.createElement("li");
    line.textContent = words.length ? `${name} (${words.join(", ")}) ` : `${name} `;
    const button = (text, action) => {
      const made = Object.assign(document.createElement("button"), { type: "button", textContent: text });
      made.setAttribute("aria-label", `${text} ${name}`);
      made.addEventListener("click", action);
      line.append(made, " ");
    };
    button("Change", () => this.#open("rename", name));
    button("Delete", () => this.#tell(() => this.#delete(name)));
    return line;
  }

  #open(act, name = "") {
    const draws = act === "draw";
    this.editing = { act, name };
    $("place-name").value = name;
    $("place-words").value = (this.site.words[name] ?? []).join(", ");
    $("place-result").textContent = "";
    for (const id of ["place-outline", "place-undo"]) $(id).hidden = !draws;
    $("place-corners").required = draws;
    $("place").hidden = false;
    $("place-draw").hidden = true;
    if (!$("layer-places").checked) $("layer-places").click();
    this.map.outline = draws ? { corners: [], closed: false } : null;
    this.#outline([]);
    if (draws) this.map.canvas.scrollIntoView({ block: "nearest" });
    $("place-name").focus({ preventScroll: draws });
  }

  #close() {
    this.editing = null;
    this.map.outline = null;
    this.map.changed();
    $("place").hidden = true;
    $("place-draw").hidden = false;
    $("place-draw").focus({ preventScroll: true });
  }

  // A click on the floor, metres; `first`: it was on the first corner.
  #point(x, y, first) {
    const { corners: so, closed } = this.map.outline;
    const corner = [x, y].map((value) => Math.round(10 * value) / 10);
    if (closed || so.length >= MOST_CORNERS || String(so.at(-1)) === String(corner)) return;
    if (first && so.length > 2) {
      this.map.outline.closed = true;
      this.map.changed();
      $("place-name").focus();
    } else this.#outline([...so, corner]);
  }

  #outline(corners) {
    if (!this.map.outline) return;
    this.map.outline = { corners, closed: false };
    $("place-corners").value = corners.map((corner) => corner.join(" ")).join(", ");
    this.map.changed();
  }

  async #save() {
    const name = $("place-name").value.trim();
    const words = $("place-words").value.split(",").map((one) => one.trim()).filter(Boolean);
    const { act, name: before } = this.editing;
    if (act === "draw" && this.map.outline.corners.length < 3) throw new Error("a place has three corners or more");
    const request = act === "draw" ? { act, name, words, polygon: this.map.outline.corners } : { act, name: before, to: name, words };
    if (act === "draw" && this.site.places.some((place) => place.name === name)) {
      if (!window.confirm(`There is a place ${name}. Is this one more part of it?`)) return "nothing was changed";
      request.part = true;
    }
    this.show(await this.ask("place", request));
    this.#close();
    return `wishes may name ${name} now`;
  }

  async #delete(name) {
    if (!window.confirm(`No new wish can name ${name} then; those in force keep it. Delete it?`)) return "nothing was changed";
    this.show(await this.ask("place", { act: "delete", name }));
    return `${name} is deleted`;
  }

  async #tell(action) {
    const words = await action().catch((error) => `not done: ${error.message}`);
    $("place-result").textContent = `${clock(Date.now() / 1000)} ${words}`;
  }
}

// "8.4 20.8, 20.8 20.8": x and y of each corner; what is no number is left out.
function corners(text) {
  const pairs = text.split(/[,;]/).map((pair) => pair.trim().split(/\s+/).map(Number));
  return pairs.filter((pair) => pair.length === 2 && pair.every(Number.isFinite));
}
