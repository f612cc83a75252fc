// What is wrong now: the alerts that fire in Prometheus; where it says nothing, what this page sees.

import { state } from "./part.js";
import { fill, text } from "./panels.js";
import { OLD_S, byId, clock, decisionOldAfter, names } from "./words.js";

const $ = (id) => document.getElementById(id);
const OLD_ALERTS_S = 20;

export function showAlerts(stream) {
  const told = stream.get("alerts");
  const link = stream.get("about")?.prometheus;
  const known = told && !told.error && stream.now() - told.at <= OLD_ALERTS_S;
  const found = known
    ? told.firing.map((one) => ({
        severity: one.severity,
        head: one.name,
        words: [one.summary, one.description].filter(Boolean).join(" "),
        since: `since ${clock(Date.parse(one.since) / 1000)}`,
      }))
    : own(stream).map((words) => ({ severity: "warning", head: "", words, since: "" }));
  text("alerts-count", found.length ? `${found.length} now` : "none");
  $("alerts-count").classList.toggle("stale", found.length > 0);
  const from = known ? "from Prometheus" : link ? "as this page sees it: Prometheus does not answer" :
    "as this page sees it: the swarm runs without Prometheus";
  text("alerts-from", from);
  fill($("alerts"), found, (one) => {
    const row = document.createElement("li");
    row.className = one.severity;
    const words = document.createElement("span");
    if (one.head) words.append(Object.assign(document.createElement("b"), { textContent: one.head }), " ");
    words.append(one.words);
    const sign = Object.assign(document.createElement("span"), { textContent: one.severity === "critical" ? "✕" : "!" });
    sign.setAttribute("aria-hidden", "true");
    row.append(sign, words, Object.assign(document.createElement("span"), { className: "age", textContent: one.since }));
    return row;
  });
}

function own(stream) {
  const now = stream.now();
  const swarm = stream.get("swarm"), decision = stream.get("decision"), demand = stream.get("demand");
  const net = stream.get("net");
  if (stream.status.kind === "lost") return ["the console does not answer"];
  if (!swarm?.connected) return swarm ? ["the swarm’s router cannot be reached"] : [];
  const found = [];
  const patience = decisionOldAfter(stream.history);
  if (decision && now - decision.at > patience) found.push(`ego ${swarm.ego} decides no more`);
  else if (decision?.blind) found.push(`ego ${swarm.ego} is blind: ${decision.blind}`);
  else if (decision && !decision.valid) found.push(`no valid decision: ${decision.reason}`);
  if (demand && now - demand.at <= patience && !(demand.possible && demand.reachable)) {
    found.push(`Q_min ${demand.q_min} is out of reach: ${demand.possible ? "C(t) is too small" : "no choice of robots reaches it"}`);
  }
  if (net && now - net.at > OLD_S.net) found.push("telemetry of the links is stale");
  else for (const why of net?.unshaped ?? []) found.push(`${why}; C(t) is only measured there`);
  if (swarm.gateway && !swarm.gateway.alive) found.push("the LLM gateway is away");
  const kinds = new Map();
  for (const robot of stream.all("robot/").sort(byId)) {
    const word = state(robot, !robot.at || now - robot.at > OLD_S.beacon);
    if (["lost", "stalled", "silent"].includes(word) && robot.since) kinds.set(word, [...(kinds.get(word) ?? []), robot.robot]);
  }
  for (const [word, robots] of kinds) found.push(`${names(robots)}: ${word}`);
  return found;
}
