// What the page says in words: the decision, events, links, robots, and the connection itself.

import { fusedWords, rates } from "./forms.js";
import { decided, part, state } from "./part.js";
import { OLD_S, ago, byId, clock, decisionOldAfter, names, rate } from "./words.js";

const $ = (id) => document.getElementById(id);

export function text(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
}

// Rows of a list, made anew only when their words differ.
export function fill(parent, rows, make) {
  const key = JSON.stringify(rows);
  if (parent.dataset.key === key) return;
  parent.dataset.key = key;
  parent.replaceChildren(...rows.map(make));
}

// Rows of a table: [class, head, cells ...]. Only words that differ are written, so that neither a
// screen reader nor a selection loses its place.
function table(body, rows, choose = null) {
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach(([className, ...words], i) => {
    const row = body.rows[i] ?? body.insertRow();
    if (row.className !== className) row.className = className;
    words.forEach((word, k) => {
      const cell = row.cells[k] ?? row.appendChild(document.createElement(k ? "td" : "th"));
      if (!k) cell.scope = "row";
      if (!k && choose) {
        headButton(cell, String(word), choose);
        return;
      }
      if (cell.textContent !== String(word)) cell.textContent = word;
    });
  });
}

// A head that opens what it names.
function headButton(cell, word, choose) {
  let button = cell.firstElementChild;
  if (!button) {
    button = document.createElement("button");
    button.type = "button";
    button.className = "link";
    button.addEventListener("click", () => choose(button.textContent));
    cell.replaceChildren(button);
  }
  if (button.textContent !== word) button.textContent = word;
}

function age(id, seconds, old, words) {
  $(id).classList.toggle("stale", seconds !== null && seconds > old);
  text(id, seconds === null ? "" : `${words} ${ago(seconds)}`);
}

export function showConnection(stream) {
  const { kind, since, why, next } = stream.status;
  const swarm = stream.get("swarm");
  const now = stream.now();
  const from = clock(since / 1000);
  let behind = "";
  const shown = {
    connecting: ["connecting", "connecting to the console …", ""],
    paused: ["connecting", "paused while nobody looks", ""],
    lost: ["lost", `no connection since ${from}`,
      `No connection to the console since ${from} (${why}). What is shown is from then.`],
    live: ["live", "live", ""],
  }[kind];
  if (kind === "live" && swarm && !swarm.connected) {
    shown[0] = "gone";
    shown[1] = `swarm away since ${clock(swarm.since)}`;
    shown[2] = `The swarm's router cannot be reached since ${clock(swarm.since)}. The console goes on trying.`;
  } else if (kind === "live" && now - stream.sent > 3) {
    shown[1] = "live, but behind";
    behind = `${(now - stream.sent).toFixed(0)} s`;
  }
  $("connection").dataset.state = shown[0];
  text("connection", shown[1]);
  // Outside what is read out, as it grows.
  text("connection-behind", behind);
  text("banner-words", shown[2]);
  // Outside the alert: nobody wants a countdown read out.
  text("banner-next", next ? `Next attempt in ${Math.max(0, Math.ceil((next - Date.now()) / 1000))} s.` : "");
  $("banner").hidden = !shown[2];
  text("swarm-name", swarm ? `· ${swarm.swarm} · ego ${swarm.ego}` : "");
}

let announced = "";

export function showDecision(stream) {
  const decision = stream.get("decision");
  const now = stream.now();
  if (!decision) {
    text("decision-what", "none yet");
    text("decision-reason", "");
    age("decision-age", null);
    fill($("decision-facts"), [], () => null);
    return;
  }
  const what = `${decision.algorithm} from ${names(decision.participants)}`;
  const old = decisionOldAfter(stream.history);
  const stale = !decided(stream);
  text("decision-what", stale ? `Was: ${what}` : !decision.valid ? `Not valid: ${what}` : decision.blind ? `Blind: ${what}` : what);
  text("decision-reason", decision.reason);
  age("decision-age", now - decision.at, old, `cycle ${decision.cycle},`);
  const demand = stream.get("demand");
  const used = stream.history.at(-1)?.used_bps;
  const by = decision.policy + (decision.model ? `, ${decision.model}` : "");
  const facts = [
    ["by", `${by} (source: ${decision.source})`],
    ["C(t)", `${rate(decision.capacity_bps)}; predicted use ${rate(decision.cost_bps)}, measured ${rate(used)}` +
      (demand?.burst_bytes && decision.assignments?.length ? `, largest frame ${(demand.burst_bytes / 1e3).toFixed(1)} kB` : "")],
    ["quality", `${decision.blind && !decision.quality ? "not known" : `${decision.quality.toFixed(2)} predicted`}` +
      (demand && now - demand.at <= old ? `, at least ${demand.q_min} asked for` : "")],
  ];
  if (decision.assignments?.length)
    facts.push(["who sends what", decision.assignments.map((one) => `${one[0]} ${one[1]} ${rates(one)}`).join(", ")]);
  if (decision.advice) facts.push(["advice", decision.advice.filter(Boolean).join(": ")]);
  if (decision.repairs.length) facts.push(["repaired", decision.repairs.join("; ")]);
  const without = stale ? "" : excluded(stream);
  if (without) facts.push(["without", without]);
  const fused = stream.get("detections");
  const missing = fused && now - fused.at <= OLD_S.boxes ? Object.entries(fused.missing) : [];
  if (missing.length) facts.push(["missing", missing.map(([robot, why]) => `${robot}: ${brief(why)}`).join("; ")]);
  fill($("decision-facts"), facts.flat(), (words, i) =>
    Object.assign(document.createElement(i % 2 ? "dd" : "dt"), { textContent: words }));
  if (what !== announced) {
    announced = what;
    text("announce", `New decision: ${what}. ${decision.reason}`);
  }
}

function brief(why) {
  return why.length > 60 ? `${why.slice(0, 59)}…` : why;
}

// Who is not in the decision, by why.
function excluded(stream) {
  const kinds = new Map();
  for (const robot of stream.all("robot/").sort(byId)) {
    const { why } = part(stream, robot);
    if (why) kinds.set(why, [...(kinds.get(why) ?? []), robot.robot]);
  }
  return [...kinds].map(([why, robots]) => `${names(robots)}: ${why}`).join("; ");
}

export function showFaults(stream) {
  const mark = { fault: "✕", good: "✓", note: "·" };
  const shown = stream.faults.slice(-100).reverse();
  fill($("faults"), shown.length ? shown : [{ level: "note", text: "nothing has happened" }], (one) => {
    const row = document.createElement("li");
    row.className = one.level;
    const time = document.createElement("time");
    time.textContent = one.at ? clock(one.at) : "";
    const sign = Object.assign(document.createElement("span"), { textContent: mark[one.level] });
    sign.setAttribute("aria-hidden", "true");
    row.append(time, sign, Object.assign(document.createElement("span"), { textContent: one.text }));
    return row;
  });
}

export function showLinks(stream) {
  const net = stream.get("net");
  const now = stream.now();
  age("net-age", net ? now - net.at : null, OLD_S.net, "measured");
  const old = net && now - net.at > OLD_S.net;
  table($("links"), (net?.links ?? []).map((link) => [
    old ? "old" : "",
    `${link.robot} ${link.direction}`,
    rate(link.capacity_bps),
    rate(link.used_bps),
    `${Math.round((100 * link.used_bps) / link.capacity_bps)} %` + (link.level ? `, level ${link.level}` : ""),
  ]));
}

export function showHistory(past) {
  text("timeline-from", past.source());
  table($("history"), past.rows().slice(-20).reverse().map((p) => [
    "", clock(p.at), p.cycle ?? "–", fusedWords(p), p.participants?.join(" ") ?? p.robots, p.valid ? p.source ?? "–" : "not valid",
    rate(p.capacity_bps), rate(p.used_bps), (p.latency_ms ?? null) === null ? "–" : `${p.latency_ms.toFixed(0)} ms`,
  ]));
}

// How a robot stands, with what is known of that.
function stateWords(r, live, old, now) {
  const word = state(r, old);
  if (r.alive) return !live ? "was alive" : word === "alive" ? word : `alive, ${word}`;
  if (word === "off duty") return `off duty, by ${r.off_duty_by}`;
  return r.since ? `lost ${ago(now - r.since)}` : "not announced";
}

// How long ago what is heard of a robot was sensed: to the ego, where that is longer ago.
function heardAgo(stream, r, now) {
  const decision = stream.get("decision");
  const told = decided(stream) ? decision.ages_s?.[r.robot] ?? 0 : 0;
  return Math.max(now - r.at, told);
}

export function showRobots(stream, choose) {
  const now = stream.now();
  const swarm = stream.get("swarm");
  const traffic = stream.get("traffic");
  const live = stream.status.kind === "live" && swarm?.connected;
  const robots = stream.all("robot/").sort(byId);
  const alive = robots.filter((r) => r.alive).length;
  text("robots-count", `${live ? "" : "last known: "}${alive} alive${robots.length > alive ? `, ${robots.length - alive} not` : ""}`);
  table($("robots"), robots.map((r) => {
    const old = !r.at || now - r.at > OLD_S.beacon;
    const scene = stream.get(`scene/${r.robot}`);
    const seen = scene && now - scene.at <= OLD_S.scene;
    const { word, why } = part(stream, r);
    const fresh = traffic && now - traffic.at <= OLD_S.traffic;
    return [
      old || !r.alive ? "old" : "",
      r.robot,
      stateWords(r, live, old, now),
      why ? `${word}: ${why}` : word || "–",
      r.at ? `${r.x.toFixed(1)}, ${r.y.toFixed(1)}` : "–",
      r.at ? `${(((r.yaw * 180) / Math.PI + 360) % 360).toFixed(0)}°` : "–",
      r.at ? `${r.speed.toFixed(1)} m/s` : "–",
      seen ? scene.objects.length : "–",
      fresh && traffic.bps[r.robot] !== undefined ? rate(traffic.bps[r.robot]) : "–",
      r.at ? (old || heardAgo(stream, r, now) > 1 ? ago(heardAgo(stream, r, now)) : "now") : "never",
    ];
  }), choose);
}

// Where else to look.
export function showAbout(stream) {
  showEgos(stream.get("about")?.egos ?? [], stream.get("swarm")?.ego ?? "");
  const link = stream.get("about")?.prometheus ?? "";
  $("prometheus-link").hidden = !link;
  if (link && $("prometheus-link").getAttribute("href") !== `${link}/alerts`) $("prometheus-link").href = `${link}/alerts`;
}

// Which ego the page shows, where several decide.
function showEgos(egos, shown) {
  const choice = $("ego-shown");
  $("ego-choice").hidden = egos.length < 2;
  if (choice.dataset.egos !== egos.join()) {
    choice.dataset.egos = egos.join();
    choice.replaceChildren(...egos.map((ego) => new Option(ego, ego)));
    choice.onchange = () => location.assign(`/?ego=${encodeURIComponent(choice.value)}`);
  }
  if (document.activeElement !== choice && egos.includes(shown)) choice.value = shown;
}
