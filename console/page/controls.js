// What an operator may do to links: the same requests that `coadapt net` sends.

import { byId, clock, rate } from "./words.js";

const $ = (id) => document.getElementById(id);
const SHOW_S = 5;

export class Controls {
  constructor(stream) {
    this.stream = stream;
    $("shape").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#send("rate", { rate_bps: this.#rate(), direction: $("shape-direction").value, ...this.#duration() });
    });
    $("congest").addEventListener("click", () => this.#send("congest", this.#duration()));
    // Without a robot the controller would end what was made of all links.
    $("stop").addEventListener("click", () =>
      this.#send("off", { direction: "both", robot: $("shape-robot").value || this.stream.get("swarm").ego }));
    $("stop-all").addEventListener("click", () => this.#send("off", { direction: "both", robot: "" }));
    setInterval(() => this.#show(), 1000 * SHOW_S);
  }

  update() {
    const may = this.stream.csrf !== "" && this.stream.get("swarm")?.connected === true;
    $("controls").disabled = !may;
    if (may && !this.shown) this.#show();
    this.shown = may;
    const robots = this.stream.all("robot/").filter((r) => r.alive).sort(byId).map((r) => r.robot);
    const key = robots.join();
    if (key === this.robots) return;
    this.robots = key;
    const select = $("shape-robot"), chosen = select.value;
    select.replaceChildren(select.options[0], ...robots.map((robot) => new Option(robot, robot)));
    select.value = robots.includes(chosen) ? chosen : "";
  }

  #rate() {
    return Math.round(1e6 * Number($("shape-rate").value));
  }

  #duration() {
    const seconds = Number($("shape-duration").value);
    return seconds > 0 ? { duration_s: seconds } : {};
  }

  async #send(profile, values) {
    $("shape-result").textContent = "asking …";
    try {
      const reply = await this.#ask({ profile, robot: $("shape-robot").value, ...values });
      this.#shapes(reply);
      $("shape-result").textContent = ["done", ...reply.notes].join("; ");
    } catch (error) {
      $("shape-result").textContent = `refused: ${error.message}`;
    }
  }

  async #show() {
    if ($("controls").disabled || document.hidden) return;
    try {
      this.#shapes(await this.#ask({ profile: "show" }));
    } catch {
      $("shapes").replaceChildren();
    }
  }

  async #ask(request) {
    const answer = await fetch("/api/shape", {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-CoAdapt-CSRF": this.stream.csrf },
      body: JSON.stringify(request),
    });
    const reply = await answer.json();
    if (!answer.ok) throw new Error(reply.error);
    return reply;
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
