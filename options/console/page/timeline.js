// A span of the past: C(t) against used bytes, who took part, how it was decided, how fast.

import { layers } from "./forms.js";
import { decisionOldAfter, rate } from "./words.js";

const LEFT = 96, RIGHT = 62, TOP = 6, BOTTOM = 20;
const LANES = [
  { name: "capacity", share: 0.42 },
  { name: "robots", share: 0.2 },
  { name: "source", share: 0.12 },
  { name: "latency", share: 0.26 },
];
const GAP = 10;
const FONT = "12px system-ui, sans-serif", SMALL = "11px system-ui, sans-serif";
const TICK_PX = 55; // What a time takes beside its neighbour.

export class Timeline {
  constructor(canvas, past, theme) {
    this.canvas = canvas;
    this.past = past;
    this.theme = theme;
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  draw() {
    const { canvas, theme: t } = this;
    const { stream, span } = this.past;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const c = canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    c.font = FONT;
    c.textBaseline = "middle";
    const now = stream.now();
    const past = this.past.rows();
    const x = (at) => LEFT + (width - LEFT - RIGHT) * (1 - (now - at) / span);
    // A gap longer than an old decision is drawn as a gap.
    const longest = decisionOldAfter(past);
    const spans = past.map((p, i) => {
      const end = past[i + 1]?.at ?? now;
      return { ...p, from: Math.max(LEFT, x(p.at)), to: x(Math.min(end, p.at + longest)) };
    }).filter((p) => p.to > LEFT);
    // Its figures stand beside the lanes, unless it is old.
    this.last = past.findLast((p) => p.at >= now - longest);
    const room = height - TOP - BOTTOM - GAP * (LANES.length - 1);
    let top = TOP;
    for (const lane of LANES) {
      const box = { top, height: room * lane.share, right: width - RIGHT };
      c.strokeStyle = t("--line");
      c.lineWidth = 1;
      c.strokeRect(LEFT + 0.5, Math.round(top) + 0.5, width - LEFT - RIGHT, Math.round(box.height));
      c.save();
      this[`_${lane.name}`](c, spans, box);
      c.restore();
      top += box.height + GAP;
    }
    this.#axis(c, x, height);
    const { last } = this;
    const said = last
      ? `the last one is ${last.algorithm ?? "–"} from ${last.robots} robots, C(t) ${rate(last.capacity_bps)}, used ${rate(last.used_bps)}`
      : `none in the last ${longest.toFixed(0)} s`;
    canvas.setAttribute("aria-label", spans.length
      ? `Timeline: ${spans.length} entries in ${spanWords(span)}; ${said}`
      : `Timeline: no decision in the last ${spanWords(span)}`);
  }

  _capacity(c, spans, box) {
    const t = this.theme;
    const top = Math.max(1, ...spans.flatMap((s) => [s.capacity_bps, s.used_bps ?? 0])) * 1.1;
    const y = (v) => box.top + box.height * (1 - v / top);
    c.fillStyle = t("--used");
    c.globalAlpha = 0.45;
    for (const s of spans) {
      if ((s.used_bps ?? null) === null) continue;
      c.fillRect(s.from, y(s.used_bps), s.to - s.from, box.top + box.height - y(s.used_bps));
    }
    c.globalAlpha = 1;
    this.#steps(c, spans, (s) => s.used_bps, y, "--used", 2);
    this.#steps(c, spans, (s) => s.capacity_bps, y, "--text", 2);
    this.#scale(c, box, rate(top));
    this.#label(c, box, `C(t) ${rate(this.last?.capacity_bps)}`, "--text", 0.3);
    this.#label(c, box, `used ${rate(this.last?.used_bps)}`, "--used-text", 0.7);
  }

  _robots(c, spans, box) {
    const most = Math.max(1, ...spans.map((s) => s.robots));
    const y = (n) => box.top + box.height * (1 - n / (most + 1));
    let from = null;
    const names = [];
    spans.forEach((s, i) => {
      c.globalAlpha = 0.35;
      let below = 0;
      for (const [colour, count] of layers(s)) {
        c.fillStyle = this.theme(colour);
        c.fillRect(s.from, y(below + count), s.to - s.from, y(below) - y(below + count));
        below += count;
      }
      c.globalAlpha = 1;
      from ??= s;
      const next = spans[i + 1];
      if (next && next.algorithm === s.algorithm && goesOn(s, next)) return;
      if (s.algorithm && s.to - from.from > 8 * s.algorithm.length) names.push([s.algorithm, from.from + 4]);
      from = null;
    });
    this.#steps(c, spans, (s) => s.robots, y, "--chosen", 2);
    c.fillStyle = this.theme("--text");
    for (const [name, at] of names) c.fillText(name, at, box.top + box.height - 9);
    this.#scale(c, box, `${most + 1} robots`);
    this.#label(c, box, `${this.last?.robots ?? "–"} robots`, "--text", 0.5);
  }

  _source(c, spans, box) {
    let from = null;
    spans.forEach((s, i) => {
      from ??= s;
      const next = spans[i + 1];
      if (next && next.source === s.source && next.valid === s.valid && goesOn(s, next)) return;
      c.fillStyle = this.theme(s.valid ? "--line" : "--fault");
      c.fillRect(from.from, box.top + 1, Math.max(1, s.to - from.from - 1), box.height - 1);
      const words = s.valid ? s.source ?? "" : "not valid";
      if (s.to - from.from > 7 * words.length) {
        c.fillStyle = this.theme(s.valid ? "--text" : "--panel");
        c.fillText(words, from.from + 4, box.top + box.height / 2);
      }
      from = null;
    });
    this.#label(c, box, "source", "--quiet", 0.5);
  }

  _latency(c, spans, box) {
    const top = Math.max(10, ...spans.map((s) => s.latency_ms ?? 0)) * 1.1;
    const y = (v) => box.top + box.height * (1 - v / top);
    this.#steps(c, spans, (s) => s.latency_ms, y, "--box", 2);
    this.#scale(c, box, `${top.toFixed(0)} ms`);
    const last = this.last?.latency_ms;
    this.#label(c, box, last === null || last === undefined ? "latency –" : `latency ${last.toFixed(0)} ms`, "--text", 0.5);
  }

  #steps(c, spans, value, y, colour, width) {
    c.strokeStyle = this.theme(colour);
    c.lineWidth = width;
    c.beginPath();
    let end = null;
    for (const s of spans) {
      const v = value(s);
      if (v === null || v === undefined) {
        end = null;
        continue;
      }
      if (end === null || !goesOn(end, s)) c.moveTo(s.from, y(v));
      else c.lineTo(s.from, y(v));
      c.lineTo(s.to, y(v));
      end = s;
    }
    c.stroke();
  }

  #label(c, box, words, colour, part) {
    c.fillStyle = this.theme(colour);
    c.textAlign = "right";
    c.fillText(words, LEFT - 8, box.top + box.height * part, LEFT - 10);
    c.textAlign = "left";
  }

  // What the lane's edges stand for.
  #scale(c, box, words) {
    c.font = SMALL;
    c.fillStyle = this.theme("--quiet");
    c.fillText(words, box.right + 4, box.top + 5, RIGHT - 6);
    c.fillText("0", box.right + 4, box.top + box.height - 4);
    c.font = FONT;
  }

  #axis(c, x, height) {
    c.fillStyle = this.theme("--quiet");
    c.textAlign = "center";
    const { span, stream } = this.past;
    const now = stream.now();
    const fine = x(now - 0.75 * span) - x(now - span) > TICK_PX;
    for (const share of fine ? [1, 0.75, 0.5, 0.25, 0] : [1, 0.5, 0]) {
      const ago = share * span;
      c.textAlign = share === 0 ? "right" : share === 1 ? "left" : "center";
      c.fillText(ago ? `−${spanWords(ago)}` : "now", x(now - ago), height - 8);
    }
    c.textAlign = "left";
  }
}

// Whether one span begins where another ends: across a gap nothing is drawn.
function goesOn(span, next) {
  return next.from <= span.to + 1;
}

// A span in its own unit.
export function spanWords(seconds) {
  const [size, unit] = seconds <= 120 ? [1, "s"] : seconds < 7200 ? [60, "min"] : [3600, "h"];
  return `${Number((seconds / size).toFixed(2))} ${unit}`;
}
