"use strict";
// A run that is going on: its events, and the repetition as it grows.

// The recording of a repetition that has not ended yet.
class Growing extends Recording {
  constructor(type, { station, axes, marks } = {}) {
    super({ key: type.key, name: type.name, station, is_program: type.is_program, end: "done", end_ms: Infinity,
      still_ms: [], done: [[0, 0]], slots: [], times: [], joints: [], speeds: [] }, { time_ms: 1, joint: 1, speed_mm_s: 1 });
    this.axes = axes ?? run.axes;
    // Numbers of the marks at which the arm waits for others, in order.
    this.marks = marks ?? [];
    this.begin(type);
  }

  begin({ key, name, is_program: isProgram }) {
    Object.assign(this, { key, name, isProgram, end: Infinity, stills: [], doneChanges: [[0, 0]], slotChanges: [], times: [], speeds: [] });
    this.columns = Array.from({ length: this.axes }, () => []);
    this.markChanges = [[0, [0, 0]]];
    // The arm after the end, on its way back to the start.
    this.later = [];
    this.quiet = null;
  }

  add({ at_ms, joints, speed_mm_s: speed, done, slots, marks = [0, 0] }) {
    const at = at_ms / 1e3;
    const known = this.markChanges.at(-1)[1];
    if (at <= this.end && marks.some((count, index) => count !== known[index])) this.markChanges.push([at, marks]);
    if (at > this.end) {
      this.later.push({ at, joints });
      if (this.later.length > 60) this.later.shift();
      return;
    }
    this.times.push(at);
    this.speeds.push(speed);
    joints.forEach((value, axis) => this.columns[axis].push(value));
    if (done > this.doneChanges.at(-1)[1]) this.doneChanges.push([at, done]);
    const before = this.slotChanges.at(-1)?.[1];
    if (!before || slots.some((motion, slot) => motion !== before[slot])) this.slotChanges.push([at, slots]);
    this.watch(at, speed);
  }

  // Notes where the arm stands still after it has moved: in two frames or more, 33 ms apart.
  watch(at, speed) {
    if (speed >= 1) this.quiet = { from: null };
    else if (this.quiet && this.quiet.from === null) this.quiet.from = at;
    else if (this.quiet?.shown) this.quiet.shown[1] = at;
    else if (this.quiet) this.stills.push(this.quiet.shown = [this.quiet.from, at]);
  }

  finish(end) {
    this.end = end;
    const kept = this.times.filter(at => at <= end).length;
    for (let index = kept; index < this.times.length; index += 1) {
      this.later.push({ at: this.times[index], joints: this.columns.map(values => values[index]) });
    }
    [this.times, this.speeds, ...this.columns].forEach(column => { column.length = kept; });
    // Where the arm stands at the end is no standstill between two motions. Its last frame may be two before the end.
    this.stills = this.stills.filter(([, to]) => to < end - 0.1);
    this.quiet = null;
  }

  get newest() { return this.later.at(-1)?.at ?? this.times.at(-1) ?? 0; }

  joints(moment) {
    const index = moment > this.end ? lastBefore(this.later.length, i => this.later[i].at, moment) : -1;
    return index < 0 ? super.joints(moment) : this.later[index].joints;
  }

  progress(moment) { return `${this.done(moment)} motions`; }

  state(moment) {
    const [come, passed] = Recording.change(this.markChanges, moment) ?? [0, 0];
    return moment < this.end && come > passed ? `waits at mark ${this.marks[come - 1]}` : super.state(moment);
  }

  // The marks that the arm has passed, and for how long it has waited at them.
  passage(moment) {
    const [, passed] = Recording.change(this.markChanges, moment) ?? [0, 0];
    const until = Math.min(moment, this.end);
    const waited = this.markChanges.reduce((sum, [from, [come, gone]], index) => {
      const to = Math.min(this.markChanges[index + 1]?.[0] ?? until, until);
      return come > gone && to > from ? sum + to - from : sum;
    }, 0);
    return `${passed} of ${this.marks.length} marks passed, waited ${waited.toFixed(2)} s`;
  }
}

// The recordings of the arms of a cell.
class GrowingCell {
  constructor(arms) { this.arms = arms; }

  begin(type) { this.arms.forEach(arm => arm.begin(type)); }

  finish(end) { this.arms.forEach(arm => arm.finish(end)); }

  add(frame) { this.arms[frame.arm ?? 0].add(frame); }

  get key() { return this.arms[0].key; }

  get end() { return this.arms[0].end; }

  get newest() { return Math.max(...this.arms.map(arm => arm.newest)); }

  get hasBegun() { return this.arms.every(arm => arm.times.length > 0); }
}

// The panels of the arms of a cell, with their marks.
class GrowingPanel extends CellPanel {
  show(moment) {
    super.show(moment);
    this.panels.forEach(({ element, recording }) => {
      const marks = element.querySelector(".marks");
      if (marks) write(marks, recording.passage(Math.min(moment, recording.end)));
    });
  }
}

// A world whose way grows; what the arm has reached stays in the picture.
class GrowingWorld extends World {
  way() {
    super.way();
    this.reach ??= new THREE.Box3();
    this.reached ??= [];
    for (const point of this.points) {
      if (!this.reach.containsPoint(point)) {
        this.reach.expandByPoint(point);
        this.reached.push(point);
        this.hasGrown = true;
      }
    }
    this.points = this.reached;
  }
}

// The repetition that runs: arm, panel and curve.
class Now {
  // Time in s by which the picture is behind the newest frame, so that it moves evenly: frames come in bundles.
  static BEHIND = 0.15;
  // Shortest time in ms between two drawings of the way and the curve.
  static REDRAW = 200;

  constructor(element) {
    this.recording = new GrowingCell(places.map(place => new Growing(run.types[0], place)));
    this.panel = new GrowingPanel(element.querySelector(".lane"), this.recording);
    this.world = Stage.isPossible() ? new GrowingWorld(this.recording) : null;
    this.stage = this.world && new Stage(element.querySelector("canvas"), [this.panel.view], [this.world]);
    this.drawn = [...document.querySelectorAll(".curve")];
    this.curves = new Curves(this.recording.arms, this.drawn, () => this.span(), () => {});
    this.hasBegun = false;
    [this.moment, this.at, this.redrawn, this.patience] = [0, null, 0, Now.REDRAW];
    this.panel.turns(this.stage, () => this.draw());
    if (!this.stage) {
      document.getElementById("flat").hidden = false;
      element.classList.add("flat");
    }
    const view = document.getElementById("view");
    view.parentElement.hidden = !this.stage;
    view.addEventListener("change", () => { this.stage?.look(view.value); this.draw(); });
    new ResizeObserver(() => this.draw()).observe(element);
    requestAnimationFrame(at => this.tick(at));
  }

  // The time axis grows in steps, so that the curve stands still between them.
  span() {
    const { end, newest } = this.recording;
    return Number.isFinite(end) ? end : Math.ceil((newest + 0.5) / 2) * 2;
  }

  begin(type) {
    this.recording.begin(type);
    this.hasBegun = true;
    this.moment = 0;
    this.redrawn = 0;
    for (const element of [this.panel.element, ...this.drawn]) {
      element.classList.remove(...run.types.map(({ key }) => key));
      element.classList.add(type.key);
    }
    const [name, how] = [document.createTextNode(`${type.name} `), document.createElement("span")];
    how.textContent = type.how;
    this.panel.element.querySelector("h2").replaceChildren(name, how);
    this.drawn.forEach(curve => { curve.querySelector("h3").firstChild.textContent = `${[type.name, curve.dataset.station].filter(Boolean).join(" ")} `; });
    this.stage?.colours();
  }

  tick(at) {
    const passed = this.at === null ? 0 : (at - this.at) / 1e3;
    this.at = at;
    const late = this.recording.newest - this.moment;
    this.moment = late > 4 * Now.BEHIND ? this.recording.newest - Now.BEHIND
      : Math.min(this.recording.newest, this.moment + passed * (late > 2 * Now.BEHIND ? 1.2 : 1));
    if (at - this.redrawn > this.patience) this.redraw(at);
    this.draw();
    requestAnimationFrame(next => this.tick(next));
  }

  // Draws what has grown. A slow machine, or a long repetition, does it less often.
  redraw(at) {
    const began = performance.now();
    this.redrawn = at;
    this.curves.grow();
    this.world?.way();
    if (this.world?.hasGrown) {
      this.world.hasGrown = false;
      this.stage.contain();
    }
    this.world?.colours();
    this.patience = Math.max(Now.REDRAW, 10 * (performance.now() - began));
  }

  draw() {
    if (!this.hasBegun) return;
    this.panel.show(this.moment);
    this.curves.show(Math.min(this.moment, this.recording.end));
    if (this.stage && this.recording.hasBegun) {
      const [tools] = this.stage.show(this.moment);
      this.panel.element.dataset.tool = tools.flatMap(tool => tool.toArray()).map(mm => mm.toFixed(1)).join(" ");
    }
  }
}

(() => {
  const find = selector => document.querySelector(selector);
  const element = (name, text, className) => {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  };
  const now = find("#stage") && new Now(find("#stage"));
  const nodes = {};
  const LINES = 200;

  const say = (text, isProblem) => {
    write(find("#state"), text);
    find("#state").classList.toggle("is-problem", isProblem);
  };

  const showRepetition = ({ key, number, of }) => {
    const type = run.types.find(type => type.key === key);
    say(`${type.name}, repetition ${number} of ${of}.`, false);
    document.querySelectorAll("#table tbody tr").forEach(row => row.classList.toggle("is-running", row.classList.contains(key)));
    now?.begin(type);
  };

  const showTable = ({ rows, improvement }) => {
    for (const { key, cells } of rows) {
      const row = find(`#table tr.${key}`);
      cells.forEach((cell, index) => write(row.cells[index + 1], cell || "–"));
    }
    write(find("#improvement"), improvement && `AETi, (SM − CM) / SM: ${improvement}.`);
  };

  const showNode = (name, figures) => {
    nodes[name] = figures;
    const part = find(`.node[data-node=${name}]`);
    write(part.querySelector(".note"), figures.summary);
    const table = part.querySelector("table");
    table.hidden = figures.lateness.length === 0;
    const most = Math.max(1, ...figures.lateness.map(([, count]) => count));
    table.tBodies[0].replaceChildren(...figures.lateness.map(([from, count]) => {
      const row = element("tr");
      const bar = element("td");
      const line = element("i");
      bar.setAttribute("aria-hidden", "true");
      // One late cycle among a million has to be seen.
      line.style.width = `${count ? 2 + 98 * Math.log1p(count) / Math.log1p(most) : 0}%`;
      bar.append(line);
      const head = element("th", `${from}–${from ? from * 2 : 1}`);
      head.scope = "row";
      row.append(head, element("td", String(count)), bar);
      return row;
    }));
    showCounters();
  };

  const showCounters = () => {
    const [known] = Object.values(nodes);
    find("#counters .note").hidden = true;
    find("#counters tbody").replaceChildren(...known.counters.map(([name], index) => {
      const row = element("tr");
      const head = element("th", name);
      head.scope = "row";
      row.append(head, ...run.nodes.map(({ key }) => element("td", nodes[key] ? String(nodes[key].counters[index][1]) : "–")));
      return row;
    }));
  };

  const log = lines => {
    const list = find("#log ol");
    for (const { at, is_problem: isProblem, text } of lines) {
      const line = element("li", undefined, isProblem ? "is-problem" : "");
      line.append(element("time", at), element("span", text));
      list.prepend(line);
    }
    while (list.children.length > LINES) list.lastChild.remove();
    find("#log .note").hidden = list.children.length > 0;
  };

  // The bench is gone when somebody reads the report, so the page keeps it. Its link to the race leads to another such page.
  const link = ({ page, race }) => {
    const address = text => URL.createObjectURL(new Blob([text], { type: "text/html" }));
    const report = element("a", "Open the report");
    report.href = address(race ? page.replace('href="race.html"', `href="${address(race)}"`) : page);
    // This page has to stay: its texts end with it.
    [report.target, report.rel] = ["_blank", "opener"];
    find("#state code")?.previousSibling.replaceWith(" ", report, ": ");
  };

  const add = part => {
    if (part.is_whole) find("#log ol").replaceChildren();
    if (part.repetition) showRepetition(part.repetition);
    part.frames?.forEach(frame => now?.recording.add(frame));
    if (part.end_ms !== undefined) now?.recording.finish(part.end_ms / 1e3);
    if (part.table) showTable(part.table);
    Object.entries(part.nodes ?? {}).forEach(([node, figures]) => showNode(node, figures));
    if (part.log) log(part.log);
    if (part.ended) {
      say(part.ended.text, part.ended.is_problem);
      if (part.ended.report) {
        find("#state").append(" Open the report: ", element("code", part.ended.report));
      }
      document.body.classList.add("is-ended");
    }
    if (part.report) link(part.report);
  };

  const source = new EventSource("/events");
  source.addEventListener("message", event => add(JSON.parse(event.data)));
  // The bench that served this page is gone, and another run is at its address.
  source.addEventListener("other-run", () => location.reload());
  source.addEventListener("open", () => { if (find("#state").dataset.isLost) { delete find("#state").dataset.isLost; say("Connected again.", false); } });
  source.addEventListener("error", () => {
    if (document.body.classList.contains("is-ended")) return source.close();
    find("#state").dataset.isLost = "yes";
    say(source.readyState === EventSource.CLOSED
      ? "The bench refuses more pages: close one of them and load this one again."
      : "The bench does not answer any more; this page tries again.", true);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    now?.stage?.colours();
    now?.curves.colours();
  });
})();
