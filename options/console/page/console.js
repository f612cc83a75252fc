// The console's page: puts its parts together.

import { showAlerts } from "./alerts.js";
import { BoxFilter } from "./boxes.js";
import { Controls } from "./controls.js";
import { FloorMap } from "./map.js";
import * as panels from "./panels.js";
import { Past } from "./past.js";
import { Places } from "./places.js";
import { watchRecordings } from "./recordings.js";
import { RobotPanel } from "./robot.js";
import { Stream } from "./stream.js";
import { Timeline } from "./timeline.js";
import { Wishes } from "./wishes.js";

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
const past = new Past(stream, () => update());
const timeline = new Timeline($("timeline"), past, theme);
const boxes = new BoxFilter(stream, () => {
  boxes.show();
  map.changed();
});
const panel = new RobotPanel(stream, (robot) => {
  map.selected = robot;
  map.changed();
});
map.leastScore = (found) => boxes.least(found);
map.onChoose = (robot) => panel.open(robot);
watchRecordings(stream);
const controls = new Controls(stream);
const wishes = new Wishes(stream, (what, request) => controls.wish(what, request));
const places = new Places(map, (what, request) => controls.wish(what, request), (site) => wishes.name(site));
let pending = 0;
let floorOf = ""; // The connection that the floor plan was asked over, and which places it had.

function update(news = false) {
  map.changed();
  // A console that has been started anew may show another world; somebody may have drawn a place.
  const wanted = stream.csrf && floorNow();
  if (wanted && wanted !== floorOf) {
    floorOf = wanted;
    loadFloor(wanted);
  }
  if (news) headlines();
  pending ||= setTimeout(words, 1000 * WORDS_S);
}

function headlines() {
  panels.showConnection(stream);
  panels.showDecision(stream);
  panels.showFaults(stream);
  showAlerts(stream);
}

function words() {
  pending = 0;
  headlines();
  panels.showLinks(stream);
  panels.showHistory(past);
  panels.showRobots(stream, (robot) => panel.open(robot));
  panels.showAbout(stream);
  panel.show();
  boxes.show();
  controls.update();
  wishes.update();
  timeline.draw();
}

for (const layer of ["range", "objects", "boxes", "blind", "places"]) {
  $(`layer-${layer}`).addEventListener("change", (event) => {
    map.layers[layer] = event.target.checked;
    map.changed();
  });
}
$("zoom-in").addEventListener("click", () => map.scaleBy(1.3));
$("zoom-out").addEventListener("click", () => map.scaleBy(1 / 1.3));
$("zoom-fit").addEventListener("click", () => map.fit());
$("span").addEventListener("change", () => past.choose(Number($("span").value)));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  colours.clear();
  update();
});

function floorNow() {
  return `${stream.csrf} ${stream.get("places") ?? ""}`;
}

async function loadFloor(wanted) {
  try {
    const answer = await fetch("/api/floor");
    if (!answer.ok) throw new Error(answer.statusText);
    map.floor = await answer.json();
    places.show(map.floor);
  } catch {
    setTimeout(() => stream.csrf && floorNow() === wanted && loadFloor(wanted), 3000);
  }
}
words();
