// One robot in full: why it takes part or not, what it sends, how old that is, and its link.

import { assigned } from "./forms.js";
import { decided, part, state } from "./part.js";
import { fill, text } from "./panels.js";
import { OLD_S, ago, bytes, rate } from "./words.js";

const $ = (id) => document.getElementById(id);

export class RobotPanel {
  constructor(stream, onChange) {
    this.stream = stream;
    this.onChange = onChange;
    this.robot = "";
    this.from = null; // What had the focus before.
    $("robot-close").addEventListener("click", () => this.close());
    $("robot").addEventListener("keydown", (event) => event.key === "Escape" && this.close());
  }

  open(robot) {
    this.from = document.activeElement;
    this.robot = robot;
    $("robot").hidden = false;
    this.show();
    $("robot-heading").focus({ preventScroll: true });
    $("robot").scrollIntoView({ block: "nearest" });
    this.onChange(robot);
  }

  close() {
    this.robot = "";
    $("robot").hidden = true;
    this.from?.focus({ preventScroll: true });
    this.onChange("");
  }

  show() {
    if (!this.robot) return;
    const robot = this.stream.get(`robot/${this.robot}`);
    text("robot-heading", `Robot ${this.robot}`);
    const facts = robot ? this.#facts(robot) : [["state", "nothing is known of it any more"]];
    fill($("robot-facts"), facts.flat(), (words, i) =>
      Object.assign(document.createElement(i % 2 ? "dd" : "dt"), { textContent: words }));
  }

  #facts(robot) {
    const { stream } = this;
    const now = stream.now();
    const old = !robot.at || now - robot.at > OLD_S.beacon;
    const word = state(robot, old);
    const facts = [["state", word === "off duty" ? `off duty, by ${robot.off_duty_by}` : word]];
    facts.push(["takes part", this.#why(robot)]);
    facts.push(["sends", this.#sends(robot, now)]);
    const sizes = stream.get(`sizes/${this.robot}`);
    if (sizes && Object.keys(sizes).length) {
      facts.push(["a frame takes", Object.entries(sizes).sort((a, b) => a[1] - b[1]).map(([a, n]) => `${a} ${bytes(n)}`).join(", ")]);
    }
    const scene = stream.get(`scene/${this.robot}`);
    facts.push(["describes", scene && now - scene.at <= OLD_S.scene ? `${scene.objects.length} objects, ${ago(now - scene.at)}` : "nothing new"]);
    facts.push(["heard", this.#heard(robot, now)]);
    facts.push(["link", this.#links(now)]);
    if (robot.at) {
      facts.push(["place", `${robot.x.toFixed(1)}, ${robot.y.toFixed(1)} m; ${robot.speed.toFixed(1)} m/s; sees ${robot.range_m.toFixed(0)} m`]);
    }
    return facts;
  }

  // The ego's own words where it has some, else the facts that it decides by.
  #why(robot) {
    const decision = this.stream.get("decision");
    const { word, why } = part(this.stream, robot);
    if (!word) return "not known: the ego has not decided yet";
    if (!decided(this.stream)) return `${word} in the last decision, which is old`;
    if (word === "ego") return "it is the ego: it fuses what the others send";
    if (word === "yes") {
      const share = decision.arrival[robot.robot];
      const time = share === undefined ? "" : `; ${Math.round(100 * share)} % of its answers are expected in time`;
      const sends = assigned(decision, robot.robot);
      const what = sends ? `; it sends ${sends}` : "";
      return (why ? `yes, but ${why}` : "yes") + what + time;
    }
    if (why !== "not chosen") return `no: ${why}`;
    const size = this.stream.get(`sizes/${robot.robot}`)?.[decision.algorithm];
    const more = size === undefined ? "" :
      ` It would add ${rate(8 * size * decision.rate_hz)} to the ${rate(decision.cost_bps)} that are planned, of C(t) ${rate(decision.capacity_bps)}.`;
    return `no: it could, but was not chosen (${decision.policy}: ${decision.reason.replace(/\.$/, "")}).${more}`;
  }

  #sends(robot, now) {
    const traffic = this.stream.get("traffic");
    const fused = this.stream.get("detections");
    const missing = fused && now - fused.at <= OLD_S.boxes ? fused.missing[robot.robot] : undefined;
    const bps = traffic && now - traffic.at <= OLD_S.traffic ? traffic.bps[robot.robot] : undefined;
    // A frame may be of several forms, and of others than this robot's.
    const own = decided(this.stream) ? assigned(this.stream.get("decision"), robot.robot) : "";
    const all = fused?.algorithm === "mixed" ? "" : fused?.algorithm;
    const words = bps ? `${rate(bps)}, as ${own || all || "observations"}` : "no observations";
    return missing ? `${words}; missing: ${missing}` : words;
  }

  #heard(robot, now) {
    if (!robot.at) return "no beacon yet";
    const told = decided(this.stream) ? this.stream.get("decision").ages_s?.[robot.robot] : undefined;
    const sensed = told === undefined ? "" : `; what the ego knows of it was sensed ${ago(told)}`;
    return `beacon ${ago(now - robot.at)}${sensed}`;
  }

  #links(now) {
    const net = this.stream.get("net");
    if (!net || now - net.at > OLD_S.net) return "not measured";
    const ego = this.stream.get("swarm")?.ego;
    const own = net.links.filter((link) => link.robot === this.robot);
    // What it sends goes through the ego's cell, too.
    const cell = net.links.find((link) => link.robot === ego && link.direction === "down");
    const found = own.map((link) => `${link.direction}: ${carried(link)}`);
    if (!own.length) found.push("not shaped itself");
    if (cell && this.robot !== ego) found.push(`the ego’s cell: ${carried(cell)}`);
    return found.join("; ");
  }
}

function carried(link) {
  return `${rate(link.used_bps)} of ${rate(link.capacity_bps)}, ${link.latency_ms} ms` +
    (link.drops ? `, ${link.drops} packets dropped` : "") + (link.level ? `, level ${link.level}` : "");
}
