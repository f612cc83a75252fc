// A recorded link in Mahimahi's format as the mean rate of each second, bit/s: as `coadapt net
// shape --trace` reads it (network_controller/mahimahi.py).

const PACKET_BITS = 12000;
const INTERVAL_MS = 1000;
const MOST = 100_000;

export function rates(text) {
  const lines = text.split("\n");
  if (lines.at(-1) === "") lines.pop();
  const packets = new Map();
  let last = 0;
  lines.forEach((line, i) => {
    const word = line.trim();
    if (!/^\d+$/.test(word) || Number(word) < last) {
      throw new Error(`line ${i + 1} is ${JSON.stringify(word.slice(0, 32))}; it must be milliseconds that do not go back`);
    }
    last = Number(word);
    // A packet at the very end of an interval belongs to it.
    const interval = Math.max(0, Math.ceil(last / INTERVAL_MS) - 1);
    packets.set(interval, (packets.get(interval) ?? 0) + 1);
  });
  if (last === 0) throw new Error("the file holds no trace");
  // What is less than half an interval at the end is left out.
  const count = Math.max(1, Math.floor(last / INTERVAL_MS + 0.5));
  if (count > MOST) throw new Error(`the trace lasts ${count} s; allowed are ${MOST}`);
  return Array.from({ length: count }, (_, i) =>
    Math.round(((packets.get(i) ?? 0) * PACKET_BITS * 1000) / Math.min(INTERVAL_MS, last - i * INTERVAL_MS)));
}
