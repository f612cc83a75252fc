// The live map: floor, robots, links, objects, boxes, and the ground that nobody sees.

import { CELL_M, covered, markSeen } from "./ground.js";
import { listen } from "./mapinput.js";
import { decided, part, state } from "./part.js";
import { drawOutline, drawPlaces } from "./placemark.js";
import { CROWD, drawRobot } from "./robotmark.js";
import { OLD_S, byId } from "./words.js";

const MOST_CELLS = 4e6; // No floor is larger; without a plan robots anywhere on earth would stretch it.
const SEEN_S = 0.25; // Seen ground is counted no more often: a hundred robots describe much.
const ROOM_M = 3;
const REACH_PX = 22; // A finger is no finer.
const GONE_S = 60; // A robot that has left stays on the map for so long.
const NOT_COUNTED = { key: "", at: -Infinity, path: null, share: null };

export class FloorMap {
  constructor(canvas, stream, theme) {
    this.canvas = canvas;
    this.stream = stream;
    this.theme = theme;
    this.floor = { width_m: null, depth_m: null, rects: [], places: [] };
    this.layers = { range: false, objects: true, boxes: true, blind: true, places: false };
    this.zoom = 1;
    this.middle = null; // Of what is shown, metres; null: all of it.
    this.last = new Map(); // Where robots were last heard of.
    this.blind = NOT_COUNTED;
    this.shown = []; // Robots as they were drawn last: id, x, y in pixels.
    this.selected = ""; // The robot that the page tells more of.
    this.leastScore = () => 0; // Boxes of a lower score are not drawn.
    this.onChoose = () => {};
    this.outline = null; // {corners, closed} of a place that is being drawn, metres.
    this.onPoint = () => {}; // Hears of clicks then: x and y, metres, and whether on the first corner.
    listen(this);
    new ResizeObserver(() => this.changed()).observe(canvas);
  }

  fit() {
    this.zoom = 1;
    this.middle = null;
    this.changed();
  }

  scaleBy(factor) {
    this.zoom = Math.min(20, Math.max(1, this.zoom * factor));
    if (this.zoom === 1) this.middle = null;
    this.changed();
  }

  changed() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      this.draw();
    });
  }

  robots(now) {
    const ego = this.stream.get("swarm")?.ego;
    const fresh = decided(this.stream);
    const found = [];
    for (const id of this.last.keys()) if (!this.stream.get(`robot/${id}`)) this.last.delete(id);
    for (const robot of this.stream.all("robot/").sort(byId)) {
      if (robot.at) this.last.set(robot.robot, robot);
      const where = robot.at ? robot : this.last.get(robot.robot);
      if (!where || (!robot.alive && now - (robot.since ?? where.at) > GONE_S)) continue;
      found.push({
        ...where,
        alive: robot.alive,
        since: robot.since,
        state: state(robot, now - where.at > OLD_S.beacon),
        ego: robot.robot === ego,
        selected: robot.robot === this.selected,
        chosen: fresh && ["ego", "yes"].includes(part(this.stream, robot).word),
        unknown: !fresh,
        old: now - where.at > OLD_S.beacon,
      });
    }
    return found;
  }

  draw() {
    const { canvas, theme: t, stream } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    // A finger scrolls the page until there is something to move.
    canvas.style.touchAction = this.zoom > 1 ? "none" : "auto";
    const now = stream.now();
    const robots = this.robots(now);
    const c = canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    const extent = this.#extent(robots);
    const view = this.#view(extent, width, height);
    this.scale = view.scale;
    this.shownAt = { ...view, width, height };
    const at = (x, y) => [(x - view.x) * view.scale + width / 2, height / 2 - (y - view.y) * view.scale];

    c.save();
    c.translate(width / 2, height / 2);
    c.scale(view.scale, -view.scale);
    c.translate(-view.x, -view.y);
    this.#drawFloor(c, view.scale);
    const scenes = this.#scenes(now);
    if (this.layers.blind) this.#seenGround(extent, scenes, now);
    else this.blind = NOT_COUNTED;
    if (this.blind.path) this.#drawBlind(c, view.scale, ratio);
    if (this.layers.range) this.#drawRange(c, robots, view.scale);
    c.restore();

    if (this.layers.places) drawPlaces(c, this.floor.places, at, t);
    if (this.layers.objects) this.#drawObjects(c, scenes, at, view.scale);
    if (this.layers.boxes) this.#drawBoxes(c, now, at, view.scale);
    this.#drawLinks(c, robots, now, at);
    // Participants over others, the ego over all.
    const order = [...robots].sort((a, b) => a.ego - b.ego || a.chosen - b.chosen);
    const how = { theme: t, count: robots.length, named: robots.length <= CROWD || this.zoom >= 2 };
    for (const robot of order) drawRobot(c, robot, at(robot.x, robot.y), now, how);
    if (this.outline) drawOutline(c, this.outline, at, t);
    this.shown = robots.map((robot) => [robot.robot, ...at(robot.x, robot.y)]);
    this.#drawScale(c, width, height);
    if (!robots.length) {
      c.fillStyle = t("--quiet");
      c.font = "15px system-ui, sans-serif";
      c.textAlign = "center";
      c.fillText("No robot is on the floor.", width / 2, height / 2);
    }
    this.#describe(robots);
  }

  #extent(robots) {
    if (this.floor.width_m) return [0, 0, this.floor.width_m, this.floor.depth_m];
    if (!robots.length) return this.seenExtent ?? [0, 0, 50, 50];
    const reach = 25;
    const box = [
      Math.min(...robots.map((r) => r.x)) - reach, Math.min(...robots.map((r) => r.y)) - reach,
      Math.max(...robots.map((r) => r.x)) + reach, Math.max(...robots.map((r) => r.y)) + reach,
    ];
    // In whole tens, so that the map does not creep with every step of a robot.
    this.seenExtent = [...box.slice(0, 2).map((v) => 10 * Math.floor(v / 10)), ...box.slice(2).map((v) => 10 * Math.ceil(v / 10))];
    return this.seenExtent;
  }

  #view([left, low, right, high], width, height) {
    const fit = Math.min(width / (right - left + ROOM_M), height / (high - low + ROOM_M));
    this.extent = [left, low, right, high];
    const [x, y] = this.middle ?? [(left + right) / 2, (low + high) / 2];
    return { x, y, scale: fit * this.zoom };
  }

  #drawFloor(c, scale) {
    const { width_m: w, depth_m: d, rects } = this.floor;
    if (!w) return;
    c.fillStyle = this.theme("--panel");
    c.fillRect(0, 0, w, d);
    c.fillStyle = this.theme("--wall");
    c.strokeStyle = this.theme("--wall-edge");
    c.lineWidth = 0.7 / scale;
    for (const [x, y, right, top] of rects) {
      c.fillRect(x, y, right - x, top - y);
      c.strokeRect(x, y, right - x, top - y);
    }
  }

  // What robots see now; what they saw earlier says nothing about the floor of today.
  #scenes(now) {
    const found = new Map();
    for (const [name, scene] of this.stream.state) {
      if (name.startsWith("scene/") && scene && now - scene.at <= OLD_S.scene) found.set(name.slice(6), scene);
    }
    return found;
  }

  #seenGround(extent, scenes, now) {
    const key = [...extent, ...[...scenes].map(([robot, scene]) => robot + scene.at)].join();
    if (key === this.blind.key || Math.abs(now - this.blind.at) < SEEN_S) return;
    const [left, low, right, high] = extent;
    const columns = Math.ceil((right - left) / CELL_M), rows = Math.ceil((high - low) / CELL_M);
    if (columns * rows > MOST_CELLS) {
      this.blind = NOT_COUNTED;
      return;
    }
    const seen = covered(this.floor.rects, columns, rows, left, low);
    let blind = 0, free = seen.reduce((n, cell) => n + (cell === 0), 0);
    for (const scene of scenes.values()) markSeen(seen, scene, columns, rows, left, low);
    const path = new Path2D();
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        if (seen[row * columns + column]) continue;
        const start = column;
        while (column < columns && !seen[row * columns + column]) column++;
        blind += column - start;
        path.rect(left + start * CELL_M, low + row * CELL_M, (column - start) * CELL_M, CELL_M);
      }
    }
    // Without any scene nothing is known, which is not the same as not seen.
    this.blind = { key, at: now, path: scenes.size ? path : null, share: scenes.size && free ? blind / free : null };
  }

  #drawBlind(c, scale, ratio) {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 8 * ratio;
    const p = tile.getContext("2d");
    p.scale(ratio, ratio);
    p.strokeStyle = this.theme("--blind");
    p.lineWidth = 1;
    p.beginPath();
    for (const shift of [-8, 0, 8]) {
      p.moveTo(shift, 8);
      p.lineTo(shift + 8, 0);
    }
    p.stroke();
    c.save();
    c.clip(this.blind.path);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.globalAlpha = 0.7;
    c.fillStyle = c.createPattern(tile, "repeat");
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    c.restore();
  }

  #drawRange(c, robots, scale) {
    c.strokeStyle = this.theme("--range");
    c.lineWidth = 1 / scale;
    c.globalAlpha = 0.5;
    c.setLineDash([4 / scale, 5 / scale]);
    for (const robot of robots) {
      if (robot.old || !robot.alive) continue;
      c.beginPath();
      c.arc(robot.x, robot.y, robot.range_m, 0, 2 * Math.PI);
      c.stroke();
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  #drawObjects(c, scenes, at, scale) {
    c.fillStyle = this.theme("--object");
    c.globalAlpha = 0.8;
    const size = Math.max(2, Math.min(5, 0.25 * scale));
    for (const scene of scenes.values()) {
      for (const [x, y] of scene.objects) {
        const [px, py] = at(x, y);
        c.fillRect(px - size / 2, py - size / 2, size, size);
      }
    }
    c.globalAlpha = 1;
  }

  #drawBoxes(c, now, at, scale) {
    const found = this.stream.get("detections");
    if (!found || now - found.at > OLD_S.boxes) return;
    for (const [, x, y, length, wide, heading, doubt] of found.known ?? []) {
      const [px, py] = at(x, y);
      c.save();
      c.translate(px, py);
      c.rotate(-heading);
      c.lineWidth = 1;
      c.strokeStyle = this.theme(doubt ? "--lost" : "--quiet");
      if (doubt) c.setLineDash([3, 3]);
      c.strokeRect((-length / 2) * scale, (-wide / 2) * scale, length * scale, wide * scale);
      c.restore();
    }
    c.strokeStyle = this.theme("--box");
    const least = this.leastScore(found);
    const remembered = found.remembered ?? [];
    for (const [x, y, length, wide, heading, score, age] of [...found.boxes, ...remembered]) {
      if (score < least) continue;
      const [px, py] = at(x, y);
      c.save();
      c.translate(px, py);
      c.rotate(-heading);
      c.lineWidth = age ? 1 : 2;
      if (age) c.setLineDash([4, 3]);
      c.strokeRect((-length / 2) * scale, (-wide / 2) * scale, length * scale, wide * scale);
      c.beginPath();
      c.moveTo((length / 2) * scale - 4, 0);
      c.lineTo((length / 2) * scale + 3, 0);
      c.stroke();
      c.restore();
    }
  }

  // A line to each participant: what it sends, as a share of what the link carries.
  #drawLinks(c, robots, now, at) {
    const ego = robots.find((r) => r.ego);
    const decision = this.stream.get("decision");
    const traffic = this.stream.get("traffic");
    if (!ego) return;
    const fresh = traffic && now - traffic.at <= OLD_S.traffic;
    for (const robot of robots) {
      if (!robot.chosen || robot.ego || !robot.alive) continue;
      const use = fresh ? (traffic.bps[robot.robot] ?? 0) / this.capacity(robot.robot, now, decision) : null;
      const kind = use === null ? "--quiet" : use > 0.66 ? "--high" : use > 0.33 ? "--mid" : "--low";
      c.strokeStyle = this.theme(kind);
      c.lineWidth = use === null ? 1 : use > 0.66 ? 5 : use > 0.33 ? 3 : 1.5;
      c.setLineDash(use === null ? [3, 4] : []);
      c.globalAlpha = 0.75;
      c.beginPath();
      c.moveTo(...at(robot.x, robot.y));
      c.lineTo(...at(ego.x, ego.y));
      c.stroke();
      c.globalAlpha = 1;
      c.setLineDash([]);
    }
  }

  // What one robot may send, bit/s: its own link where that is shaped, and the ego's cell.
  capacity(robot, now, decision) {
    const net = this.stream.get("net");
    const own = net && now - net.at <= OLD_S.net
      ? net.links.find((link) => link.robot === robot && link.direction === "up")
      : null;
    return Math.max(1, Math.min(decision.capacity_bps, own?.capacity_bps ?? Infinity));
  }

  // How long ten metres, or what fits, are on the screen.
  #drawScale(c, width, height) {
    const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].findLast((m) => m * this.scale < width / 4);
    if (!metres) return;
    const right = width - 12, y = height - 12;
    c.strokeStyle = c.fillStyle = this.theme("--text");
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(right - metres * this.scale, y - 5);
    c.lineTo(right - metres * this.scale, y);
    c.lineTo(right, y);
    c.lineTo(right, y - 5);
    c.stroke();
    c.font = "12px system-ui, sans-serif";
    c.textAlign = "right";
    c.lineWidth = 3;
    c.strokeStyle = this.theme("--ground");
    c.strokeText(`${metres} m`, right, y - 9);
    c.fillText(`${metres} m`, right, y - 9);
  }

  // A click on the canvas: the next corner of what is being drawn, else the robot there, if any.
  choose(x, y) {
    if (this.outline) {
      this.#point(x, y);
      return;
    }
    const near = this.shown
      .map(([robot, rx, ry]) => [Math.hypot(rx - x, ry - y), robot])
      .filter(([distance]) => distance <= REACH_PX)
      .sort((a, b) => a[0] - b[0])[0];
    if (near) this.onChoose(near[1]);
  }

  #point(x, y) {
    const { x: middleX, y: middleY, scale, width, height } = this.shownAt;
    const [corner] = this.outline.corners;
    const metres = [middleX + (x - width / 2) / scale, middleY + (height / 2 - y) / scale];
    const first = corner && Math.hypot(corner[0] - metres[0], corner[1] - metres[1]) * scale <= REACH_PX;
    this.onPoint(...metres, Boolean(first));
  }

  moveBy(dx, dy) {
    const [left, low, right, high] = this.extent;
    const [x, y] = this.middle ?? [(left + right) / 2, (low + high) / 2];
    this.middle = [
      Math.min(right, Math.max(left, x - dx / this.scale)),
      Math.min(high, Math.max(low, y + dy / this.scale)),
    ];
    this.changed();
  }

  #describe(robots) {
    const alive = robots.filter((r) => r.alive);
    const share = this.blind.share === null ? "" : `; ${Math.round(100 * this.blind.share)} % of the ground is seen by nobody`;
    const parts = alive.some((r) => r.unknown) ? "who takes part is not known" : `${alive.filter((r) => r.chosen).length} take part`;
    const words = `Map of the floor: ${alive.length} robots, ${parts}${share}`;
    if (this.canvas.getAttribute("aria-label") !== words) this.canvas.setAttribute("aria-label", words);
  }
}
