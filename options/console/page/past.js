// What was decided and used: heard since this page was opened, and before that from Prometheus.

import { address } from "./stream.js";

const LIVE_S = 120; // What the stream itself holds.
const ASK_S = { 120: 10, 900: 5, 3600: 15, 21600: 60 }; // By span: as often as it brings news.

export class Past {
  constructor(stream, onChange) {
    this.stream = stream;
    this.onChange = onChange;
    this.span = LIVE_S;
    this.told = []; // What Prometheus has said of this span.
    this.trouble = ""; // Why it says nothing.
    this.begun = 0; // The newest question: answers to others are of other spans.
    this.#ask();
  }

  choose(span) {
    this.span = span;
    this.told = [];
    this.trouble = "";
    this.#ask();
    this.onChange();
  }

  // Oldest first: at, capacity_bps, used_bps, robots, algorithm, source, valid, latency_ms.
  rows() {
    const first = this.stream.now() - this.span;
    const from = this.#heardFrom();
    const before = this.told.filter((p) => p.at >= first && (this.span > LIVE_S || p.at < from));
    if (this.span > LIVE_S) return before;
    const known = before.at(-1)?.at ?? -Infinity;
    const live = this.stream.history.filter((p) => p.at > known);
    return [...before, ...live.map((p) => ({ ...p, robots: p.participants.length }))];
  }

  // Since when what was used is known: the stream tells of decisions while nobody looked, but not of
  // what was used then.
  #heardFrom() {
    const { history } = this.stream;
    return history[history.findLastIndex((p) => p.used_bps === null) + 1]?.at ?? Infinity;
  }

  // Where it is from, in words.
  source() {
    if (this.trouble && this.span > LIVE_S) return `not known: ${this.trouble}`;
    if (this.trouble) return `used bytes and latency only since this page was opened: ${this.trouble}`;
    if (!this.told.length) return "";
    return this.span > LIVE_S ? "from Prometheus" : "the older part from Prometheus";
  }

  async #ask() {
    clearTimeout(this.timer);
    const mine = ++this.begun;
    const needed = this.span > LIVE_S || this.#heardFrom() > this.stream.now() - LIVE_S;
    if (needed && !document.hidden) {
      try {
        const answer = await fetch(address(`/api/history?span=${this.span}`));
        const reply = await answer.json().catch(() => ({ error: answer.statusText }));
        if (mine !== this.begun) return;
        this.told = answer.ok ? reply.rows.map((row) => ({ ...row, valid: true })) : [];
        this.trouble = answer.ok ? "" : reply.error;
      } catch {
        if (mine !== this.begun) return;
        this.trouble = "the console does not answer"; // What it said before stays.
      }
      this.onChange();
    }
    this.timer = setTimeout(() => this.#ask(), 1000 * ASK_S[this.span]);
  }
}
