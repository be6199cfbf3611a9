"use strict";
// What a lane says of its recording at a moment: clock, state, motions done and slots.

// Writes a text only where it changes: the page is laid out again otherwise.
const write = (element, text) => { if (element.textContent !== text) element.textContent = text; };

class Panel {
  constructor(element, recording) {
    const part = selector => element.querySelector(selector);
    this.element = element;
    this.recording = recording;
    [this.time, this.state] = part(".clock").children;
    this.view = part(".view");
    this.done = part(".done");
    this.slots = [...part(".slots").children];
    this.about = part(".about-slots");
  }

  show(moment) {
    const { recording, element } = this;
    write(this.time, `${Math.min(moment, recording.end).toFixed(2)} s`);
    write(this.state, recording.state(moment));
    element.classList.toggle("is-done", moment >= recording.end);
    const { count, now } = recording.still(moment);
    element.classList.toggle("is-still", now && moment < recording.end);
    write(this.done.firstElementChild, recording.progress(moment));
    write(this.done.lastElementChild, `stood still ${count} ×`);
    const held = recording.slots(moment);
    held.forEach((motion, slot) => {
      this.slots[slot].className = motion ? "full" : "";
      write(this.slots[slot], motion ? String(motion) : "");
    });
    write(this.about, recording.isProgram ? "The robot has its program: no slot is used."
      : `${held.filter(Boolean).length} of 5 slots hold a motion.`);
  }

  // Turns the stage where the view is dragged.
  turns(stage, show) {
    this.view.addEventListener("pointerdown", event => this.view.setPointerCapture(event.pointerId));
    this.view.addEventListener("pointermove", event => {
      if (stage && event.buttons & 1) {
        stage.drag(event.movementX, event.movementY);
        show();
      }
    });
  }
}

// What a lane says of the arms of a cell: a panel for each.
class CellPanel {
  constructor(element, recording) {
    this.element = element;
    this.recording = recording;
    this.view = element.querySelector(".view");
    this.panels = [...element.querySelectorAll(".arm")].map((part, index) => new Panel(part, recording.arms[index]));
  }

  show(moment) { this.panels.forEach(panel => panel.show(moment)); }

  turns(stage, show) { Panel.prototype.turns.call(this, stage, show); }
}
