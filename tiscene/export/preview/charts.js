// Small charts over time: measures of difficulty, and the pixels of the selected object.

const MEASURES = {
  instances: "visible objects",
  categories: "their categories",
  visibility: "visible part of an object, 0 to 1",
  size: "part of the picture that an object fills, 0 to 1",
  motion: "length of flow where something moves, px",
  moving: "part of the picture that moves, 0 to 1",
  contrast: "contrast of an object with what is around it, 0 to 1",
  novelty: "angle to the nearest view shown before, degrees",
};

class Chart {
  constructor(parent, title, values, onFrame) {
    this.root = document.createElement("div");
    this.root.className = "chart";
    this.label = document.createElement("span");
    this.svg = svgElement("svg", {viewBox: "0 0 100 38", preserveAspectRatio: "none"});
    this.root.append(this.label, this.svg);
    parent.append(this.root);
    this.cursor = svgElement("line", {y1: 0, y2: 38}, this.svg);
    this.svg.addEventListener("pointerdown", (event) => {
      const box = this.svg.getBoundingClientRect();
      onFrame(Math.round((event.clientX - box.left) / box.width * (this.values.length - 1)));
    });
    this.set(title, values);
  }

  set(title, values) {
    this.title = title;
    this.values = values;
    for (const line of this.svg.querySelectorAll("polyline")) line.remove();
    const highest = values.reduce((most, value) => Math.max(most, value ?? 0), 0) || 1;
    const span = Math.max(values.length - 1, 1);
    let run = [];
    const draw = () => { if (run.length) svgElement("polyline", {points: run.join(" ")}, this.svg); run = []; };
    values.forEach((value, frame) => {
      if (value === null || value === undefined) draw();
      else run.push(`${100 * frame / span},${36 - 34 * value / highest}`);
    });
    draw();
  }

  show(frame) {
    const value = this.values[frame], x = 100 * frame / Math.max(this.values.length - 1, 1);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    this.label.replaceChildren(this.title, document.createElement("b"));
    this.label.lastChild.textContent = value === null || value === undefined ? "–" : String(value);
  }
}
