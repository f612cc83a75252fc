// What robots send: who sends what, and the colours of that.

const COLOURED = ["early", "intermediate", "late", "mixed"];

// The name of an algorithm's colour; quiet where there is none.
export function algorithmColour(name) {
  const family = COLOURED.find((one) => name?.startsWith(one));
  return family ? `--${family}` : "--quiet";
}

// The robots of one entry of the past, from the bottom up: [colour, how many] of each form. The ego
// sends nothing, and of older entries nobody knows who sent what: these are neutral.
export function layers({ algorithm, robots, forms }) {
  if (algorithm !== "mixed") return [[algorithmColour(algorithm), robots]];
  const sent = Object.entries(forms ?? {});
  const rest = Math.max(0, robots - sent.reduce((sum, [, count]) => sum + count, 0));
  return [["--mixed", rest], ...sent.map(([form, count]) => [algorithmColour(form), count])];
}

// What was fused, and of how many where that differs.
export function fusedWords({ algorithm, forms }) {
  if (algorithm !== "mixed" || !forms) return algorithm ?? "–";
  return `mixed: ${Object.entries(forms).map(([form, count]) => `${count} ${form}`).join(", ")}`;
}

// How often a robot sends, whether only what may be an object, and how often it is asked in between
// about the places of what is remembered.
export function rates([, , hz, placesHz, objectsOnly]) {
  const notes = [...(objectsOnly ? ["objects"] : []), ...(placesHz ? [`places: ${placesHz} Hz`] : [])];
  return `${hz} Hz${notes.length ? ` (${notes.join("; ")})` : ""}`;
}

// Form and rate of one robot, where the decision assigns them.
export function assigned(decision, robot) {
  const found = decision?.assignments?.find(([name]) => name === robot);
  return found ? `${found[1]} at ${rates(found)}` : "";
}
