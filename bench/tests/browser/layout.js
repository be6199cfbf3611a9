// Returns what is wrong with the layout of a page, as sentences.
(() => {
  const faults = [];
  const tell = (what, element, more = "") => {
    const path = [element.closest("section, header, figure")?.id || element.closest("section, header, figure")?.tagName, element.tagName, element.getAttribute("class")];
    faults.push(`${what}: ${path.filter(Boolean).join(" ")} "${element.textContent.trim().slice(0, 40)}" ${more}`);
  };
  const isSeen = element => {
    // What is folded has a box as well.
    if (!element.checkVisibility({ visibilityProperty: true })) return false;
    const box = element.getBoundingClientRect();
    return box.width > 0 && box.height > 0;
  };
  // Text for the ears alone is clipped on purpose.
  const all = [...document.body.querySelectorAll("*")].filter(isSeen).filter(e => getComputedStyle(e).clipPath === "none");
  const [root, slack] = [document.documentElement, 1];
  if (root.scrollWidth > innerWidth) faults.push(`the page is ${root.scrollWidth} px wide in a window of ${innerWidth}`);

  // A wide table may scroll within itself, but not on paper.
  const scrolls = element => element.closest(".scroll") && getComputedStyle(element.closest(".scroll")).overflowX === "auto";
  for (const element of all.filter(e => !e.closest("svg") && !e.closest(".u-wrap") && !scrolls(e))) {
    const box = element.getBoundingClientRect();
    if (box.right > innerWidth + slack || box.left < -slack) tell("outside", element, `${box.left}..${box.right}`);
    const { overflowX } = getComputedStyle(element);
    if (overflowX !== "visible" && element.scrollWidth > element.clientWidth + slack) tell("clipped", element);
  }

  const ownText = e => [...e.childNodes].some(node => node.nodeType === Node.TEXT_NODE && node.textContent.trim());
  const written = all.filter(e => ownText(e) && !e.matches("option, title, script, style"));

  // Labels of a figure lie in it.
  for (const label of written.filter(e => e.matches("svg text"))) {
    const [box, figure] = [label, label.ownerSVGElement].map(e => e.getBoundingClientRect());
    if (box.left < figure.left - slack || box.right > figure.right + slack || box.top < figure.top - slack || box.bottom > figure.bottom + slack) {
      tell("clipped label", label);
    }
  }

  // No two texts lie on each other. The lines of a text have a box each; two lines of a page may touch.
  const lines = written.flatMap(element => [...element.childNodes].filter(node => node.nodeType === Node.TEXT_NODE && node.textContent.trim())
    .flatMap(node => {
      const range = document.createRange();
      range.selectNodeContents(node);
      return [...range.getClientRects()].map(box => ({ element, box }));
    }));
  const fixed = element => element.closest("#controls, sup, .u-wrap");
  lines.sort((a, b) => a.box.top - b.box.top);
  lines.forEach((one, index) => {
    for (const other of lines.slice(index + 1)) {
      if (other.box.top > one.box.bottom) break;
      const across = Math.min(one.box.right, other.box.right) - Math.max(one.box.left, other.box.left);
      const down = Math.min(one.box.bottom, other.box.bottom) - Math.max(one.box.top, other.box.top);
      const least = Math.min(one.box.height, other.box.height) * 0.3;
      if (across > 2 && down > least && one.element !== other.element && !fixed(one.element) && !fixed(other.element)) {
        tell("overlap", one.element, `with "${other.element.textContent.trim().slice(0, 40)}"`);
      }
    }
  });

  // Contrast by WCAG 2, level AA.
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = colour => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = ([r, g, b, a], below) => [r, g, b].map((part, index) => part * a + below[index] * (1 - a));
  const behind = element => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) layers.push(rgba(getComputedStyle(e).backgroundColor));
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const luminance = colour => colour.map(part => part / 255)
    .map(part => (part <= 0.03928 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4))
    .reduce((sum, part, index) => sum + part * [0.2126, 0.7152, 0.0722][index], 0);
  for (const element of written) {
    const style = getComputedStyle(element);
    const isLabel = element.matches("svg text");
    const scale = isLabel ? element.getScreenCTM().a : 1;
    const size = parseFloat(style.fontSize) * scale;
    const ground = behind(isLabel ? element.ownerSVGElement : element);
    const ink = over(rgba(isLabel ? style.fill : style.color), ground);
    const [dark, light] = [luminance(ink), luminance(ground)].sort((a, b) => a - b);
    const ratio = (light + 0.05) / (dark + 0.05);
    const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (isLarge ? 3 : 4.5)) tell("contrast", element, `${ratio.toFixed(2)}`);
    if (size < 9.5) tell("small", element, `${size.toFixed(1)} px`);
  }
  return faults;
})()
