// The swarm's recordings, listed when somebody opens the list.

import { fill } from "./panels.js";
import { bytes, clock } from "./words.js";

const $ = (id) => document.getElementById(id);

export function watchRecordings(stream) {
  $("recordings-open").parentElement.addEventListener("toggle", async (event) => {
    if (!event.target.open) return;
    let found = [{ name: "", words: "the console does not answer" }];
    try {
      const answer = await fetch("/api/recordings");
      if (answer.ok) found = await answer.json();
    } catch {
      // As said.
    }
    const swarm = stream.get("swarm")?.swarm ?? "";
    const none = [{ name: "", words: `none yet: coadapt record --swarm ${swarm}` }];
    fill($("recordings"), found.length ? found : none, (one) => {
      const row = document.createElement("li");
      if (!one.name) row.textContent = one.words;
      else {
        const link = Object.assign(document.createElement("a"), { textContent: one.name, download: one.name });
        link.href = `/recordings/${encodeURIComponent(one.name)}`;
        const day = new Date(1000 * one.at).toLocaleDateString();
        row.append(link, ` ${bytes(one.bytes)}, ${day} ${clock(one.at)}`);
      }
      return row;
    });
  });
}
