// The console's page: puts its parts together.

import { Controls } from "./controls.js";
import { FloorMap } from "./map.js";
import * as panels from "./panels.js";
import { Stream } from "./stream.js";
import { Timeline } from "./timeline.js";

const WORDS_S = 0.4; // People read no faster than this what is no news; the map moves with every frame.
const $ = (id) => document.getElementById(id);

const colours = new Map();
function theme(name) {
  if (!colours.has(name)) {
    colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  }
  return colours.get(name);
}

const stream = new Stream((news) => update(news));
const map = new FloorMap($("map"), stream, theme);
const timeline = new Timeline($("timeline"), stream, theme);
const controls = new Controls(stream);
let pending = 0;
let floorOf = ""; // The connection that the floor plan was asked over.

function update(news = false) {
  map.changed();
  // A console that has been started anew may show another world.
  if (stream.csrf && stream.csrf !== floorOf) {
    floorOf = stream.csrf;
    loadFloor(floorOf);
  }
  if (news) headlines();
  pending ||= setTimeout(words, 1000 * WORDS_S);
}

function headlines() {
  panels.showConnection(stream);
  panels.showDecision(stream);
  panels.showFaults(stream);
}

function words() {
  pending = 0;
  headlines();
  panels.showLinks(stream);
  panels.showHistory(stream);
  panels.showRobots(stream);
  controls.update();
  timeline.draw();
}

for (const layer of ["range", "objects", "boxes", "blind"]) {
  $(`layer-${layer}`).addEventListener("change", (event) => {
    map.layers[layer] = event.target.checked;
    map.changed();
  });
}
$("zoom-in").addEventListener("click", () => map.scaleBy(1.3));
$("zoom-out").addEventListener("click", () => map.scaleBy(1 / 1.3));
$("zoom-fit").addEventListener("click", () => map.fit());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  colours.clear();
  update();
});

async function loadFloor(connection) {
  try {
    const answer = await fetch("/api/floor");
    if (!answer.ok) throw new Error(answer.statusText);
    map.floor = await answer.json();
    map.changed();
  } catch {
    setTimeout(() => stream.csrf === connection && loadFloor(connection), 3000);
  }
}
words();
