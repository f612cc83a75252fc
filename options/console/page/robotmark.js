// One robot on the map: shapes say the same as colours.

import { ago } from "./words.js";

const ROBOT_PX = 8;
export const CROWD = 30; // Of more robots each is small, and named only when one looks closer.

export function drawRobot(c, robot, [x, y], now, { theme: t, count, named }) {
  const r = count > CROWD ? 5 : ROBOT_PX;
  c.save();
  c.translate(x, y);
  c.globalAlpha = robot.state === "silent" ? 0.45 : 1;
  if (robot.state === "lost") {
    c.strokeStyle = t("--lost");
    c.lineWidth = 3;
    c.beginPath();
    c.moveTo(-r, -r); c.lineTo(r, r); c.moveTo(r, -r); c.lineTo(-r, r);
    c.stroke();
  } else if (robot.state === "off duty") {
    // A ring with a bar: parked, nothing is wrong.
    c.strokeStyle = t("--quiet");
    c.lineWidth = 2.5;
    c.beginPath();
    c.arc(0, 0, r, 0, 2 * Math.PI);
    c.moveTo(-r / 2, 0); c.lineTo(r / 2, 0);
    c.stroke();
  } else if (robot.state === "stalled") {
    // Two bars: its process stands still.
    c.fillStyle = t("--lost");
    c.fillRect(-r, -r, 0.7 * r, 2 * r);
    c.fillRect(0.3 * r, -r, 0.7 * r, 2 * r);
  } else {
    c.strokeStyle = t(robot.chosen ? "--chosen" : robot.unknown ? "--quiet" : "--excluded");
    c.fillStyle = robot.chosen ? t("--chosen") : t("--panel");
    c.lineWidth = 2.5;
    c.beginPath();
    c.moveTo(Math.cos(robot.yaw) * r, -Math.sin(robot.yaw) * r);
    c.lineTo(Math.cos(robot.yaw) * 2.1 * r, -Math.sin(robot.yaw) * 2.1 * r);
    c.stroke();
    if (robot.old) c.setLineDash([3, 3]);
    c.beginPath();
    if (robot.chosen) c.arc(0, 0, r, 0, 2 * Math.PI);
    else c.rect(-r + 1, -r + 1, 2 * r - 2, 2 * r - 2);
    c.fill();
    c.stroke();
    if (robot.ego) {
      c.setLineDash([]);
      c.strokeStyle = t("--text");
      c.lineWidth = 2;
      c.beginPath();
      c.arc(0, 0, r + 4, 0, 2 * Math.PI);
      c.stroke();
    }
  }
  if (robot.selected) {
    c.setLineDash([4, 3]);
    c.strokeStyle = t("--mid");
    c.lineWidth = 2;
    c.globalAlpha = 1;
    c.beginPath();
    c.arc(0, 0, 2.1 * r + 2, 0, 2 * Math.PI);
    c.stroke();
  }
  c.restore();
  if (!named && !robot.selected && !robot.ego && robot.alive && !robot.old) return;
  const old = robot.state === "alive" ? "" :
    ` ${robot.state} ${ago(now - (robot.alive ? robot.at : robot.since ?? robot.at))}`;
  c.font = "600 12px system-ui, sans-serif";
  c.textAlign = "left";
  c.lineWidth = 3;
  c.lineJoin = "round";
  c.strokeStyle = t("--panel");
  c.strokeText(robot.robot + old, x + r + 5, y - r);
  const fine = ["alive", "off duty"].includes(robot.state);
  c.fillStyle = fine ? t("--text") : t("--fault");
  c.fillText(robot.robot + old, x + r + 5, y - r);
}
