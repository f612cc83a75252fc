// What an operator may do: the same requests that `coadapt net` and `coadapt steer` send.

import { rates } from "./mahimahi.js";
import { byId, clock, rate } from "./words.js";

const $ = (id) => document.getElementById(id);
const SHOW_S = 5;
const DAY_SCALE = 3600; // The working day of 24 h in 24 s.

export class Controls {
  constructor(stream) {
    this.stream = stream;
    this.choices = new Map();
    $("shape").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#shape("rate", { rate_bps: this.#rate(), ...this.#where() });
    });
    $("shift").addEventListener("click", () => this.#shape("shift", { ...this.#where(), time_scale: DAY_SCALE }));
    $("trace").addEventListener("click", () => $("trace-file").click());
    $("trace-file").addEventListener("change", () => this.#trace());
    $("congest").addEventListener("click", () => this.#shape("congest", this.#duration()));
    // Without a robot the controller would end what was made of all links.
    $("relieve").addEventListener("click", () =>
      this.#shape("relieve", { robot: $("shape-robot").value || this.stream.get("swarm").ego }));
    $("stop").addEventListener("click", () =>
      this.#shape("off", { direction: "both", robot: $("shape-robot").value || this.stream.get("swarm").ego }));
    $("stop-all").addEventListener("click", () => this.#shape("off", { direction: "both", robot: "" }));
    $("ego").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#ego({ policy: $("ego-policy").value, q_min: Number($("ego-q-min").value) });
    });
    for (const input of ["ego-policy", "ego-q-min"]) {
      $(input).addEventListener("input", () => (this.edited = true));
    }
    $("duty-off").addEventListener("click", () => this.#duty("off"));
    $("duty-on").addEventListener("click", () => this.#duty("on"));
    setInterval(() => this.#look(), 1000 * SHOW_S);
  }

  update() {
    const may = this.stream.csrf !== "" && this.stream.get("swarm")?.connected === true;
    for (const part of ["controls", "steering"]) $(part).disabled = !may;
    if (may && !this.shown) this.#look();
    if (!may) $("shapes").replaceChildren(); // Nobody knows what is in force.
    this.shown = may;
    const robots = this.stream.all("robot/").sort(byId);
    this.#choose("shape-robot", robots.filter((r) => r.alive).map((r) => r.robot), "the ego’s cell");
    this.#choose("duty-robot", robots.filter((r) => r.alive || r.off_duty_by).map((r) => r.robot), "choose …");
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

  async #shape(profile, values) {
    await this.#tell("shape-result", async () => {
      const reply = await this.#ask("shape", { profile, robot: $("shape-robot").value, ...values });
      this.#shapes(reply);
      return ["done", ...reply.notes].join("; ");
    });
  }

  async #ego(wish) {
    await this.#tell("steer-result", async () => {
      const reply = await this.#ask("ego", { wish });
      this.edited = false;
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
    await this.#tell("steer-result", async () => {
      const reply = await this.#ask(`robot/${robot}`, { duty });
      return `${robot} is ${reply.on_duty ? "on" : "off"} duty`;
    });
  }

  async #tell(id, action) {
    $(id).textContent = "asking …";
    const words = await action().catch((error) => `not done: ${error.message}`);
    $(id).textContent = `${clock(Date.now() / 1000)} ${words}`;
  }

  // What is in force, whoever asked for it.
  async #look() {
    if ($("controls").disabled || document.hidden) return;
    this.#ask("shape", { profile: "show" }).then((reply) => this.#shapes(reply), () => $("shapes").replaceChildren());
    this.#ask("ego", { wish: {} }).then((reply) => this.#steered(reply), () => {});
  }

  async #ask(what, request) {
    const answer = await fetch(`/api/${what}`, {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-CoAdapt-CSRF": this.stream.csrf },
      body: JSON.stringify(request),
    });
    const reply = await answer.json().catch(() => ({ error: answer.statusText }));
    if (!answer.ok) throw new Error(reply.error);
    return reply;
  }

  // Never under the hands of who is changing it.
  #steered(reply) {
    if (this.edited) return;
    this.#choose("ego-policy", reply.policies);
    $("ego-policy").value = reply.policy;
    $("ego-q-min").value = reply.q_min;
  }

  #shapes(reply) {
    const words = reply.shapes.map((shape) => {
      const until = shape.until_ns ? ` until ${clock(shape.until_ns / 1e9)}` : "";
      const kind = shape.profile === "rate" ? "" : ` (${shape.profile})`;
      return `${shape.robot} ${shape.direction}: ${rate(shape.rate_bps)}${kind}${until}, by ${shape.operator} since ${clock(shape.since_ns / 1e9)}`;
    });
    if (reply.congested.length) words.push(`telemetry runs towards ${reply.congested.join(", ")}`);
    if (!words.length) words.push("no link is shaped");
    $("shapes").replaceChildren(...words.map((one) => Object.assign(document.createElement("li"), { textContent: one })));
  }
}
