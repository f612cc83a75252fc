// Who takes part in the fusion, and why others do not: the ego's decision names who is left out and
// why; of older egos, that do not, it follows from what is known of each robot.

import { OLD_S, decisionOldAfter } from "./words.js";

// Whether the decision still says what is done.
export function decided(stream) {
  const decision = stream.get("decision");
  return Boolean(decision) && stream.now() - decision.at <= decisionOldAfter(stream.history);
}

// {word, why}: word is "ego", "yes" or "no", "was in" or "was not" where the decision is old, or ""
// before the first; why tells why it is not in, or that nothing of it arrives although it is, or that others see it
// elsewhere, or what is odd about it.
export function part(stream, robot) {
  const decision = stream.get("decision");
  if (!decision) return { word: "", why: "" };
  const inIt = decision.participants.includes(robot.robot);
  if (!decided(stream)) return { word: inIt ? "was in" : "was not", why: "" };
  if (robot.robot === stream.get("swarm")?.ego) return { word: "ego", why: "" };
  const doubt = decision.doubted?.[robot.robot] ?? decision.remarks?.[robot.robot];
  if (inIt) return { word: "yes", why: decision.silent?.[robot.robot] ?? doubt ?? "" };
  return { word: "no", why: whyNot(stream, robot, decision) };
}

// What a robot is in one word: alive, off duty, lost, silent or stalled.
export function state(robot, old) {
  if (!robot.alive) return robot.off_duty_by ? "off duty" : "lost";
  if (!old) return "alive";
  return robot.answers === false ? "stalled" : "silent";
}

function whyNot(stream, robot, decision) {
  if (!robot.alive) return robot.off_duty_by ? "off duty" : "lost";
  const why = decision.excluded?.[robot.robot] ?? decision.doubted?.[robot.robot];
  if (why) return why;
  if (!robot.at || stream.now() - robot.at > OLD_S.beacon) return "silent";
  const swarm = stream.get("swarm");
  const ego = stream.get(`robot/${swarm?.ego}`);
  if (!ego?.at) return "not chosen";
  return Math.hypot(robot.x - ego.x, robot.y - ego.y) > swarm.comm_range_m ? "out of range" : "not chosen";
}
