"use strict";
// The clock, the controls and what the lanes say.

(() => {
  const find = id => document.getElementById(id);
  const stageElement = find("stage");
  const [scrub, play, speed, view] = ["scrub", "play", "speed", "view"].map(find);
  const CYCLE = run.cycle_ms / 1e3;
  let moment = 0;
  let playing = null;

  const lanes = recordings.map(recording =>
    new (recording.arms ? CellPanel : Panel)(stageElement.querySelector(`.lane[data-type=${recording.key}]`), recording));

  const stage = Stage.isPossible() ? new Stage(stageElement.querySelector("canvas"), lanes.map(lane => lane.view), recordings.map(recording => new World(recording))) : null;
  if (!stage) {
    find("flat").hidden = false;
    stageElement.classList.add("flat");
    find("view").parentElement.hidden = true;
  }
  const curves = new Curves(recordings.flatMap(recording => recording.arms ?? [recording]), [...document.querySelectorAll(".curve")], () => longest, at => seek(at));

  const show = () => {
    lanes.forEach(lane => lane.show(moment));
    curves.show(moment);
    const tools = stage?.show(moment) ?? [];
    const written = tool => tool.toArray().map(mm => mm.toFixed(2)).join(" ");
    tools.forEach((of, index) => { lanes[index].element.dataset.tool = of.map(written).join(" "); });
    scrub.value = moment;
    scrub.setAttribute("aria-valuetext", `${moment.toFixed(2)} s`);
    write(find("time"), `${moment.toFixed(3)} s`);
  };

  const result = () => lanes.map(({ recording }) => `${recording.name}: ${recording.state(moment)}, ${recording.progress(moment)}`).join("; ");

  const pause = () => {
    playing = null;
    play.textContent = "Play";
    document.body.classList.remove("is-playing");
    write(find("said"), `${moment.toFixed(2)} s. ${result()}.`);
  };

  const seek = to => {
    moment = Math.min(longest, Math.max(0, to));
    show();
    if (playing === null) write(find("said"), "");
  };

  const start = () => {
    if (moment >= longest) seek(0);
    playing = performance.now();
    play.textContent = "Pause";
    document.body.classList.add("is-playing");
    write(find("said"), "");
    requestAnimationFrame(frame);
  };

  const frame = at => {
    if (playing === null) return;
    // A page that was hidden goes on where it was.
    const passed = Math.min(0.1, Math.max(0, (at - playing) / 1e3));
    playing = at;
    seek(moment + passed * Number(speed.value));
    if (moment >= longest) pause(); else requestAnimationFrame(frame);
  };

  const toggle = () => (playing === null ? start() : pause());
  const step = by => { if (playing !== null) pause(); seek(Math.round((moment + by) / CYCLE) * CYCLE); };
  const choose = (select, by) => {
    select.selectedIndex = (select.selectedIndex + by + select.length) % select.length;
    select.dispatchEvent(new Event("change"));
  };
  const bounded = by => { speed.selectedIndex = Math.min(speed.length - 1, Math.max(0, speed.selectedIndex + by)); };

  scrub.max = longest;
  scrub.addEventListener("input", () => { if (playing !== null) pause(); seek(Number(scrub.value)); });
  play.addEventListener("click", toggle);
  find("back").addEventListener("click", () => step(-CYCLE));
  find("forward").addEventListener("click", () => step(CYCLE));
  view.addEventListener("change", () => { stage?.look(view.value); show(); });

  const keys = {
    " ": toggle, k: toggle,
    ArrowLeft: event => step(event.shiftKey ? -0.1 : -CYCLE), ArrowRight: event => step(event.shiftKey ? 0.1 : CYCLE),
    Home: () => seek(0), End: () => seek(longest),
    ",": () => bounded(-1), ".": () => bounded(1), v: () => choose(view, 1),
  };
  addEventListener("keydown", event => {
    const target = event.target;
    // A list and a button have keys of their own.
    if (event.ctrlKey || event.altKey || event.metaKey || target.matches("select, a")) return;
    if (target.matches("button") && event.key === " ") return;
    const act = keys[event.key];
    if (act) {
      event.preventDefault();
      act(event);
    }
  });

  lanes.forEach(lane => lane.turns(stage, show));

  const isCalm = matchMedia("(prefers-reduced-motion: reduce)");
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    stage?.colours();
    curves.colours();
    show();
  });
  new ResizeObserver(show).observe(stageElement);
  addEventListener("beforeprint", show);

  // `#t=2.5` opens the page at that moment; the report's picture does so.
  const asked = /^#t=([\d.]+)$/.exec(location.hash);
  seek(asked ? Number(asked[1]) : isCalm.matches ? Math.min(...recordings.map(recording => recording.end)) : 0);
  if (!asked && !isCalm.matches) start();
})();
