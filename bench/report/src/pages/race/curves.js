"use strict";
// The speed curves, one below the other on one time axis, with a cursor that all share.

class Curves {
  constructor(recordings, elements, longest, seek) {
    this.moment = 0;
    this.longest = longest;
    this.recordings = recordings;
    this.scale();
    this.panels = recordings.map((recording, index) => this.panel(recording, elements[index], seek));
    new ResizeObserver(() => this.resize()).observe(elements[0].parentElement);
    this.resize();
  }

  scale() {
    const fastest = ({ speeds }) => speeds.reduce((a, b) => Math.max(a, b), 0);
    this.fastest = Math.max(1, ...this.recordings.map(fastest));
  }

  // Draws recordings again that have grown.
  grow() {
    this.scale();
    this.panels.forEach(({ recording, plot }) => plot.setData(Curves.data(recording)));
  }

  static data({ times, speeds }) { return [times, speeds].map(column => Array.from(column)); }

  panel(recording, element, seek) {
    const [out, place] = [element.querySelector("output"), element.lastElementChild];
    const isLast = recording === this.recordings.at(-1);
    const head = document.createElement("i");
    head.className = "head";
    const axis = extra => ({
      stroke: () => colourOf("muted"), font: "12px system-ui, sans-serif",
      grid: { stroke: () => colourOf("grid"), width: 1 }, ticks: { stroke: () => colourOf("axis"), width: 1, size: 4 }, ...extra,
    });
    const plot = new uPlot({
      width: 300, height: Curves.height(isLast), pxAlign: 0,
      legend: { show: false },
      padding: [6, 10, 0, 0],
      scales: { x: { time: false, range: () => [0, this.longest() * 1.005] }, y: { range: () => [0, this.fastest * 1.08] } },
      axes: [axis({ size: isLast ? 26 : 6, values: isLast ? undefined : (self, ticks) => ticks.map(() => "") }), axis({ size: 44, space: 28 })],
      cursor: { sync: { key: "race" }, drag: { x: false, y: false, setScale: false }, y: false, points: { show: false } },
      series: [{}, {
        stroke: () => colourOf(recording.key), width: 1.5, points: { show: false },
        fill: () => `color-mix(in srgb, ${colourOf(recording.key)} 18%, transparent)`,
      }],
      hooks: {
        drawClear: [self => Curves.shade(self, recording)],
        setCursor: [self => this.say(recording, out, self.cursor.left >= 0 ? self.posToVal(self.cursor.left, "x") : null)],
      },
    }, Curves.data(recording), place);
    plot.over.append(head);
    const go = event => {
      if (event.buttons & 1 || event.type === "click") {
        seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
      }
    };
    ["click", "pointermove"].forEach(type => plot.over.addEventListener(type, go));
    return { recording, plot, head, out };
  }

  static height(isLast) { return (innerWidth < 704 ? 84 : 110) + (isLast ? 20 : 0); }

  // Marks where the arm stands still.
  static shade({ ctx, bbox, valToPos }, recording) {
    ctx.save();
    ctx.fillStyle = colourOf("grid");
    for (const [from, to] of recording.stills) {
      const left = valToPos(from, "x", true);
      ctx.fillRect(left, bbox.top, Math.max(1, valToPos(to, "x", true) - left), bbox.height);
    }
    ctx.restore();
  }

  say(recording, out, hovered) {
    const moment = hovered ?? this.moment;
    out.textContent = moment > recording.end && hovered !== null ? "" :
      `${recording.speed(moment).toFixed(0)} mm/s at ${moment.toFixed(3)} s`;
  }

  resize() {
    for (const { recording, plot } of this.panels) {
      const width = plot.root.parentElement.clientWidth;
      if (width > 0) plot.setSize({ width, height: Curves.height(recording === this.recordings.at(-1)) });
    }
    this.show(this.moment);
  }

  show(moment) {
    this.moment = moment;
    for (const { recording, plot, head, out } of this.panels) {
      head.style.transform = `translateX(${plot.valToPos(moment, "x")}px)`;
      if (!(plot.cursor.left >= 0)) this.say(recording, out, null);
    }
  }

  colours() { this.panels.forEach(({ plot }) => plot.redraw()); }
}
