// Figures and times as people read them, and what counts as old.

export const OLD_S = { beacon: 2, scene: 2, boxes: 1.5, net: 4, traffic: 3 };

export function rate(bps) {
  if (bps === null || bps === undefined) return "–";
  if (bps >= 1e6) return `${(bps / 1e6).toFixed(bps < 1e8 ? 1 : 0)} Mbit/s`;
  if (bps >= 1e3) return `${(bps / 1e3).toFixed(0)} kbit/s`;
  return `${Math.round(bps)} bit/s`;
}

export function bytes(count) {
  if (count >= 1e6) return `${(count / 1e6).toFixed(1)} MB`;
  if (count >= 1e3) return `${(count / 1e3).toFixed(1)} kB`;
  return `${count} B`;
}

export function ago(seconds) {
  if (seconds < 0.05) return "now";
  if (seconds < 10) return `${seconds.toFixed(1)} s ago`;
  if (seconds < 120) return `${Math.round(seconds)} s ago`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min ago`;
  return `${Math.round(seconds / 3600)} h ago`;
}

export function clock(epoch_s) {
  return new Date(1000 * epoch_s).toLocaleTimeString([], { hourCycle: "h23" });
}

// After how long a decision is old: three periods of the ego, but no less than five seconds. Its
// period is the least of the last gaps: a longer one may be an outage. Before the second decision
// nobody knows it.
export function decisionOldAfter(history) {
  const last = history.slice(-5);
  const gaps = last.slice(1).map((one, i) => one.at - last[i].at);
  return gaps.length ? Math.max(5, 3 * Math.min(...gaps)) : 60;
}

const ids = new Intl.Collator(undefined, { numeric: true });

export function byId(a, b) {
  return ids.compare(a.robot, b.robot);
}

// Ids in one line: the first dozen of many.
export function names(robots) {
  const more = robots.length - 12;
  return more > 1 ? `${robots.slice(0, 12).join(", ")} and ${more} more` : robots.join(", ");
}
