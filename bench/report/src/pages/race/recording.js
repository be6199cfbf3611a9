"use strict";
// The recordings: columns decoded, and what was at a moment.

const run = JSON.parse(document.getElementById("run").textContent);

// Columns are differences of whole numbers.
const column = (differences, unit) => {
  const values = new Float64Array(differences.length);
  let sum = 0;
  differences.forEach((difference, index) => { sum += difference; values[index] = sum * unit; });
  return values;
};

// The index of the last entry that is not later than this moment; -1 before the first.
const lastBefore = (length, timeOf, moment) => {
  let [low, high] = [0, length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (timeOf(middle) <= moment) low = middle + 1; else high = middle;
  }
  return low - 1;
};

class Recording {
  constructor(lane, units) {
    this.key = lane.key;
    this.name = lane.name;
    this.station = lane.station;
    this.isProgram = lane.is_program;
    this.ends = lane.end;
    this.end = lane.end_ms / 1e3;
    this.stills = lane.still_ms.map(stretch => stretch.map(ms => ms / 1e3));
    this.doneChanges = lane.done.map(([ms, count]) => [ms / 1e3, count]);
    this.slotChanges = lane.slots.map(([ms, motions]) => [ms / 1e3, motions]);
    this.times = column(lane.times, units.time_ms / 1e3);
    this.speeds = column(lane.speeds, units.speed_mm_s);
    this.columns = lane.joints.map(joint => column(joint, units.joint));
    this.all = this.doneChanges.at(-1)[1];
  }

  // The joints at a moment: on the line between two ticks.
  joints(moment) {
    const index = Math.max(0, lastBefore(this.times.length, i => this.times[i], moment));
    const next = Math.min(index + 1, this.times.length - 1);
    const span = this.times[next] - this.times[index];
    const share = span > 0 ? Math.min(1, Math.max(0, (moment - this.times[index]) / span)) : 0;
    return this.columns.map(values => values[index] + (values[next] - values[index]) * share);
  }

  speed(moment) {
    const index = lastBefore(this.times.length, i => this.times[i], moment);
    return index < 0 || moment > this.end ? 0 : this.speeds[index];
  }

  static change(changes, moment) {
    const index = lastBefore(changes.length, i => changes[i][0], moment);
    return index < 0 ? null : changes[index][1];
  }

  done(moment) { return Recording.change(this.doneChanges, moment) ?? 0; }

  progress(moment) {
    return `${this.done(moment)} of ${this.all}${this.ends === "done" ? "" : " recorded"} motions`;
  }

  slots(moment) { return Recording.change(this.slotChanges, moment) ?? [0, 0, 0, 0, 0]; }

  // How often the arm has stood still so far, and whether it does.
  still(moment) {
    const count = lastBefore(this.stills.length, i => this.stills[i][0], moment) + 1;
    return { count, now: count > 0 && moment <= this.stills[count - 1][1] };
  }

  // What the arm does at a moment.
  state(moment) {
    if (moment >= this.end) return ["done", "failed", "interrupted"].includes(this.ends) ? this.ends : "recorded no further";
    if (this.still(moment).now) return "stands still";
    return this.speed(moment) >= 1 ? "moves" : moment === 0 ? "starts" : "waits";
  }
}

// The recordings of the arms of a cell in one repetition.
class CellRecording {
  constructor(lane, units) {
    this.key = lane.key;
    this.name = lane.name;
    this.arms = lane.arms.map(arm => new Recording(arm, units));
    this.end = Math.max(...this.arms.map(arm => arm.end));
  }

  state(moment) { return this.arms.map(arm => `${arm.station} ${arm.state(moment)}`).join(", "); }

  progress(moment) { return this.arms.map(arm => `${arm.station} ${arm.progress(moment)}`).join(", "); }
}

const recordings = run.lanes.map(lane => lane.arms ? new CellRecording(lane, run.units) : new Recording(lane, run.units));
const longest = Math.max(...recordings.map(recording => recording.end));
const colourOf = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
