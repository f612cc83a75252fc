// What an operator may do: the same requests that `coadapt net` and `coadapt steer` send.

import { rates } from "./mahimahi.js";
import { fill } from "./panels.js";
import { address } from "./stream.js";
import { byId, clock, rate } from "./words.js";

const $ = (id) => document.getElementById(id);
const SHOW_S = 5;
const ANSWER_S = 20; // The console itself says after 15 s that nobody answers.
const EGO_FIELDS = { policy: "ego-policy", q_min: "ego-q-min" };
const DAY_SCALE = 3600; // The working day of 24 h in 24 s.

export class Controls {
  constructor(stream) {
    this.stream = stream;
    this.choices = new Map();
    this.edited = new Set(); // Fields of the ego with what nobody has sent yet.
    this.looks = new Set(); // What is being asked for.
    this.wishes = 0; // Begun and ended ones: a look meanwhile may tell of what was before.
    $("shape").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#shape("rate", { rate_bps: this.#rate(), ...this.#where() });
    });
    this.#lasting("shift", () => this.#shape("shift", { ...this.#where(), time_scale: DAY_SCALE }));
    this.#lasting("trace", () => $("trace-file").click());
    $("trace-file").addEventListener("change", () => this.#trace());
    this.#lasting("congest", () => this.#shape("congest", this.#duration()));
    // Without a robot the controller would end what was made of all links.
    $("relieve").addEventListener("click", () =>
      this.#shape("relieve", { robot: $("shape-robot").value || this.stream.get("swarm").ego }));
    $("stop").addEventListener("click", () =>
      this.#shape("off", { direction: "both", robot: $("shape-robot").value || this.stream.get("swarm").ego }));
    $("stop-all").addEventListener("click", () => this.#stopAll());
    $("ego").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#ego();
    });
    for (const [name, id] of Object.entries(EGO_FIELDS)) {
      $(id).addEventListener("input", () => this.#edit(name, true));
    }
    $("why").addEventListener("click", () => this.#why());
    $("duty-off").addEventListener("click", () => this.#duty("off"));
    $("duty-on").addEventListener("click", () => this.#duty("on"));
    setInterval(() => this.#look(), 1000 * SHOW_S);
  }

  update() {
    const may = this.stream.csrf !== "" && this.stream.get("swarm")?.connected === true;
    this.#allow(may);
    if (may && !this.shown) this.#look();
    if (!may) {
      // Nobody knows what is in force.
      this.#shapes(null);
      this.#steered(null);
    }
    this.shown = may;
    const robots = this.stream.all("robot/").sort(byId);
    this.#choose("shape-robot", robots.filter((r) => r.alive).map((r) => r.robot), "the ego’s cell");
    this.#choose("duty-robot", robots.filter((r) => r.alive || r.off_duty_by).map((r) => r.robot), "choose …");
  }

  // Asks the ego, or takes away what it told.
  async #why() {
    const told = $("why-told");
    const open = told.hidden;
    let sentences = [];
    if (open) {
      $("why").disabled = true;
      try {
        const reply = await this.wish("ego", { wish: {}, why: true });
        sentences = reply.why.length ? reply.why : ["Nothing has been decided yet."];
      } catch (error) {
        sentences = [error.message];
      }
      $("why").disabled = !this.shown;
    }
    fill(told, sentences, (words) => Object.assign(document.createElement("li"), { textContent: words }));
    told.hidden = !open;
    $("why").setAttribute("aria-expanded", String(open));
  }

  #allow(may) {
    $("why").disabled = !may;
    const focused = document.activeElement;
    for (const id of ["controls", "steering", "wishing", "placing"]) {
      if (!may && !$(id).disabled && $(id).contains(focused)) this.focused = focused;
      $(id).disabled = !may;
    }
    if (!may || !this.focused) return;
    // A short loss is not to take a keyboard's user back to the top of the page.
    if (document.activeElement === document.body) this.focused.focus({ preventScroll: true });
    this.focused = null;
  }

  // A button whose wish lasts for so many seconds, where that is a number.
  #lasting(id, action) {
    $(id).addEventListener("click", () => $("shape-duration").reportValidity() && action());
  }

  // What is edited must be sent whole; what is not may be unknown.
  #edit(name, edited) {
    if (edited) this.edited.add(name);
    else this.edited.delete(name);
    $(EGO_FIELDS[name]).required = edited;
  }

  // The choices of a list, changed only when they are others. What is chosen stays, also when it has
  // left: nobody is to shape another link than the one that he chose.
  #choose(id, values, none) {
    const list = $(id), chosen = list.value;
    if (chosen && !values.includes(chosen)) values = [...values, chosen];
    const key = values.join();
    if (key === this.choices.get(id)) return;
    this.choices.set(id, key);
    const options = values.map((value) => new Option(value, value));
    list.replaceChildren(...(none ? [new Option(none, "")] : []), ...options);
    if (values.includes(chosen)) list.value = chosen;
  }

  #rate() {
    return Math.round(1e6 * Number($("shape-rate").value));
  }

  #duration() {
    const seconds = Number($("shape-duration").value);
    return seconds > 0 ? { duration_s: seconds } : {};
  }

  #where() {
    return { direction: $("shape-direction").value, ...this.#duration() };
  }

  async #trace() {
    const file = $("trace-file").files[0];
    $("trace-file").value = "";
    try {
      if (file) await this.#shape("trace", { ...this.#where(), rates_bps: rates(await file.text()) });
    } catch (error) {
      $("shape-result").textContent = `${file.name}: ${error.message}`;
    }
  }

  async #stopAll() {
    if (!window.confirm("This ends every shape and all congestion, on the links of all robots. Stop everything?")) {
      $("shape-result").textContent = "nothing was changed";
      return;
    }
    await this.#shape("off", { direction: "both", robot: "" });
  }

  async #shape(profile, values) {
    await this.#tell("shape-result", async () => {
      const reply = await this.wish("shape", { profile, robot: $("shape-robot").value, ...values });
      this.#shapes(reply);
      return ["done", ...reply.notes].join("; ");
    });
  }

  // Only what was changed here: the rest may be another operator's wish.
  async #ego() {
    const values = { policy: $("ego-policy").value, q_min: Number($("ego-q-min").value) };
    const sent = [...this.edited];
    if (!sent.length) {
      $("steer-result").textContent = "change something first";
      return;
    }
    await this.#tell("steer-result", async () => {
      for (const name of sent) this.#edit(name, false); // What is typed from now on is another wish.
      const wish = Object.fromEntries(sent.map((name) => [name, values[name]]));
      const reply = await this.wish("ego", { wish }).catch((error) => {
        for (const name of sent) this.#edit(name, true);
        throw error;
      });
      this.#steered(reply);
      return `${reply.ego} decides by ${reply.policy}, Q_min ${reply.q_min}`;
    });
  }

  async #duty(duty) {
    const robot = $("duty-robot").value;
    if (!robot) {
      $("steer-result").textContent = "choose a robot first";
      return;
    }
    const own = robot === this.stream.get("swarm").ego;
    const what = own ? `${robot} is the ego’s own robot: without it the ego is blind.` :
      `The swarm goes on without ${robot} until somebody starts it again.`;
    if (duty === "off" && !window.confirm(`${what} Stop it?`)) {
      $("steer-result").textContent = "nothing was changed";
      return;
    }
    await this.#tell("steer-result", async () => {
      const reply = await this.wish(`robot/${robot}`, { duty });
      return `${robot} is ${reply.on_duty ? "on" : "off"} duty`;
    });
  }

  async #tell(id, action) {
    $(id).textContent = "asking …";
    const words = await action().catch((error) => `not done: ${error.message}`);
    $(id).textContent = `${clock(Date.now() / 1000)} ${words}`;
  }

  // What is in force, whoever asked for it.
  #look() {
    if ($("controls").disabled || document.hidden) return;
    this.#lookAt("shape", { profile: "show" }, (reply) => this.#shapes(reply));
    this.#lookAt("ego", { wish: {} }, (reply) => this.#steered(reply));
  }

  // Nobody is asked again who has not answered yet; without an answer, null is shown.
  async #lookAt(what, request, show) {
    if (this.looks.has(what)) return;
    this.looks.add(what);
    const wishes = this.wishes;
    const reply = await this.#ask(what, request).catch(() => null);
    this.looks.delete(what);
    if (wishes === this.wishes) show(reply);
  }

  // Sends a control; returns the reply, throws an error with what was refused.
  async wish(what, request) {
    this.wishes++;
    try {
      return await this.#ask(what, request);
    } catch (error) {
      // Who only looks is left where he is.
      if (error.status === 401) location.assign("/login");
      throw error;
    } finally {
      this.wishes++;
    }
  }

  async #ask(what, request) {
    const answer = await fetch(address(`/api/${what}`), {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-CoAdapt-CSRF": this.stream.csrf },
      body: JSON.stringify(request),
      signal: AbortSignal.timeout(1000 * ANSWER_S),
    });
    const reply = await answer.json().catch(() => ({ error: answer.statusText }));
    if (!answer.ok) throw Object.assign(new Error(reply.error), { status: answer.status });
    return reply;
  }

  // How the ego decides, null where nobody knows. Never under the hands of who is changing it.
  #steered(reply) {
    if (reply) this.#choose("ego-policy", reply.policies);
    for (const [name, id] of Object.entries(EGO_FIELDS)) {
      const value = String(reply?.[name] ?? "");
      if ($(id).value === value) this.#edit(name, false);
      else if (!this.edited.has(name)) $(id).value = value;
    }
  }

  // What links are made to be, null where nobody knows.
  #shapes(reply) {
    fill($("shapes"), reply ? inForce(reply) : [], (words) =>
      Object.assign(document.createElement("li"), { textContent: words }));
  }
}

// Shapes and congestion, a line each.
function inForce(reply) {
  const words = reply.shapes.map((shape) => {
    const until = shape.until_ns ? ` until ${clock(shape.until_ns / 1e9)}` : "";
    const kind = shape.profile === "rate" ? "" : ` (${shape.profile})`;
    return `${shape.robot} ${shape.direction}: ${rate(shape.rate_bps)}${kind}${until}, by ${shape.operator} since ${clock(shape.since_ns / 1e9)}`;
  });
  if (reply.congested.length) words.push(`telemetry runs towards ${reply.congested.join(", ")}`);
  if (!words.length) words.push("no link is shaped");
  return words;
}
