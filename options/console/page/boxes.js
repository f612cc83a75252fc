// From which score on boxes are drawn: the detector's operating point, until somebody moves it.

import { text } from "./panels.js";
import { OLD_S } from "./words.js";

const $ = (id) => document.getElementById(id);
const UNCALIBRATED = 0.5; // Where the calibrated detectors' operating point lies among raw scores.

export class BoxFilter {
  constructor(stream, onChange) {
    this.stream = stream;
    this.chosen = null; // By hand; null: the operating point.
    $("box-score").addEventListener("input", () => {
      this.chosen = Number($("box-score").value);
      onChange();
    });
    $("box-reset").addEventListener("click", () => {
      this.chosen = null;
      onChange();
    });
  }

  least(found) {
    return this.chosen ?? found?.operating_point ?? UNCALIBRATED;
  }

  show() {
    const found = this.stream.get("detections");
    const least = this.least(found);
    if (Number($("box-score").value) !== least) $("box-score").value = least;
    $("box-reset").disabled = this.chosen === null;
    const all = found && this.stream.now() - found.at <= OLD_S.boxes ? found.boxes : null;
    const count = all ? `, ${all.filter((box) => box[5] >= least).length} of ${all.length} boxes` : "";
    const calibrated = found?.operating_point !== null && found?.operating_point !== undefined;
    const kind = this.chosen !== null ? "chosen here" : calibrated ? "operating point" : found ? "not calibrated" : "";
    const words = `${least.toFixed(2)}${kind ? ` (${kind})` : ""}${count}`;
    text("box-words", words);
    $("box-score").setAttribute("aria-valuetext", words);
  }
}
