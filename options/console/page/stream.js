// The stream of server-sent events: what is known now, and whether it is still coming.

const FIRST_WAIT_S = 0.5;
const LONGEST_WAIT_S = 15;
const SILENT_S = 5; // The console says something every second.
const SLEPT_S = 3; // The wall clock has jumped so far from the steady one, which stands while a machine sleeps.
const HIDDEN_S = 60; // A page that nobody sees asks for nothing.
const DRIFT = 2e-4; // Seconds a second: two clocks part no faster.
const KEPT_S = 130;
const KEPT_DECISIONS = 5; // Also of an ego that decides rarely: its period is told by them.
const KEPT_EVENTS = 200;

// The ego that this page shows, as its address says; empty: the first one.
const EGO = new URLSearchParams(location.search).get("ego") ?? "";

// Where the console answers about this page's ego.
export function address(path) {
  if (!EGO) return path;
  return `${path}${path.includes("?") ? "&" : "?"}ego=${encodeURIComponent(EGO)}`;
}

export class Stream {
  constructor(onChange) {
    this.onChange = onChange;
    this.state = new Map();
    this.history = [];
    this.faults = [];
    this.csrf = "";
    this.status = { kind: "connecting", since: Date.now() };
    this.offset = -Infinity; // The console's clock less this page's steady one, seconds.
    this.sent = 0;
    this.taken = 0; // When the last event came, on this page's steady clock.
    this.gap = wallGap();
    this.attempts = 0;
    this.abort = null; // Ends the connection, also one that is only tried; null without.
    this.timer = 0;
    document.addEventListener("visibilitychange", () => this.#visible());
    setInterval(() => this.#check(), 1000);
    this.#connect();
    this.#visible(); // It may have been opened in the background.
  }

  // Seconds since the epoch on the console's clock.
  now() {
    return this.offset === -Infinity ? Date.now() / 1000 : performance.now() / 1000 + this.offset;
  }

  get(name) {
    return this.state.get(name);
  }

  all(prefix) {
    return [...this.state].filter(([name]) => name.startsWith(prefix)).map(([, value]) => value);
  }

  async #connect() {
    clearTimeout(this.timer);
    const abort = (this.abort = new AbortController());
    this.heard = performance.now() / 1000;
    try {
      const answer = await fetch(address("/api/events"), { signal: abort.signal, cache: "no-store" });
      if (answer.status === 401) {
        location.assign("/login");
        return;
      }
      if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).error ?? answer.statusText);
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) throw new Error("the console ended the connection");
        this.heard = performance.now() / 1000;
        const events = (rest + value).split("\n\n");
        rest = events.pop();
        let news = false;
        for (const event of events) news = this.#take(JSON.parse(event.slice("data: ".length))) || news;
        if (events.length) this.onChange(news);
      }
    } catch (error) {
      if (this.abort !== abort) return;
      this.#lost(abort.signal.aborted ? abort.signal.reason : error.message);
    }
  }

  // Whether the event holds what an operator should read at once.
  #take(event) {
    const here = performance.now() / 1000;
    if (event.full) {
      this.state.clear();
      this.history = [];
      this.faults = [];
      this.csrf = event.csrf;
    }
    // Told anew by another console, and by one whose clock was set back.
    if (event.full || event.now < this.sent) this.offset = -Infinity;
    // The event that was least on its way tells the difference of the clocks best; with time they drift.
    this.offset = Math.max(this.offset - DRIFT * (here - this.taken), event.now - here);
    this.taken = here;
    this.sent = event.now;
    for (const [name, value] of Object.entries(event.state)) {
      if (value === null) this.state.delete(name);
      else this.state.set(name, value);
    }
    const first = this.now() - KEPT_S;
    const history = [...this.history, ...event.history];
    this.history = history.filter((past, i) => past.at > first || i >= history.length - KEPT_DECISIONS);
    this.faults = [...this.faults, ...event.faults].slice(-KEPT_EVENTS);
    this.attempts = 0;
    if (this.status.kind !== "live") this.status = { kind: "live", since: Date.now() };
    return Boolean(event.full || event.state.decision || event.faults.length);
  }

  #lost(why) {
    // Since the last word, not since its end was noticed.
    const silent_s = this.sent ? this.now() - this.sent : 0;
    const since = this.status.kind === "lost" ? this.status.since : Date.now() - 1000 * silent_s;
    const wait = Math.min(LONGEST_WAIT_S, FIRST_WAIT_S * 2 ** this.attempts) * (1 - Math.random() / 4);
    this.attempts = Math.min(this.attempts + 1, 10);
    this.abort = null;
    this.csrf = "";
    this.status = { kind: "lost", since, why, next: Date.now() + 1000 * wait };
    this.timer = setTimeout(() => this.#connect(), 1000 * wait);
    this.onChange(true);
  }

  #check() {
    const slept = wallGap() - this.gap;
    this.gap += slept;
    if (Math.abs(slept) > SLEPT_S) {
      // What is shown is older by that; what the console says next tells its clock anew.
      this.offset += Math.max(0, slept);
      if (this.status.kind === "live") this.abort.abort("this machine slept, or its clock was set");
    } else if (performance.now() / 1000 - this.heard > SILENT_S) {
      this.abort?.abort("the console is silent");
    }
    this.onChange();
  }

  #visible() {
    clearTimeout(this.hidden);
    if (document.hidden) {
      this.hidden = setTimeout(() => this.#pause(), 1000 * HIDDEN_S);
    } else if (this.status.kind === "paused") {
      this.status = { kind: "connecting", since: Date.now() };
      this.#connect();
    }
  }

  #pause() {
    const abort = this.abort;
    this.abort = null;
    clearTimeout(this.timer);
    abort?.abort();
    this.csrf = "";
    this.status = { kind: "paused", since: Date.now() };
    this.onChange();
  }
}

// The wall clock less the steady one, seconds.
function wallGap() {
  return (Date.now() - performance.now()) / 1000;
}
