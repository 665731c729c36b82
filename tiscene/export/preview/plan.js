// Trajectories seen from above: x to the right, z downwards, in meters.

const SVG = "http://www.w3.org/2000/svg";

function svgElement(name, attributes, parent) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.append(element);
  return element;
}

const at = (column, frame) => column[column.length === 1 ? 0 : frame];

class Plan {
  constructor(svg, content, onObject) {
    this.svg = svg;
    this.content = content;
    const corners = [];
    for (const object of content.objects) for (const box of object.bounds) if (box) corners.push(box);
    for (const [x, z] of content.cameraPath) corners.push([x, z, x, z]);
    const finite = corners.filter((box) => box.every((value) => Math.abs(value) < 1e4));
    const low = (axis) => finite.reduce((least, box) => Math.min(least, box[axis]), Infinity);
    const high = (axis) => finite.reduce((most, box) => Math.max(most, box[axis]), -Infinity);
    const [x0, z0, x1, z1] = finite.length ? [low(0), low(1), high(2), high(3)] : [-1, -1, 1, 1];
    const size = Math.max(x1 - x0, z1 - z0, 0.1), margin = 0.05 * size;
    this.unit = size / 100;
    svg.setAttribute("viewBox", [x0 - margin, z0 - margin, x1 - x0 + 2 * margin, z1 - z0 + 3.2 * margin].join(" "));
    for (const object of content.objects) if (!object.moves) this.box(object, at(object.bounds, 0), "still", onObject);
    for (const object of content.objects) {
      const points = object.moves ? object.positions.filter(Boolean) : [];
      if (points.length > 1) svgElement("polyline", {class: "path", stroke: object.color, points: points.map((p) => `${p[0]},${p[2]}`).join(" ")}, svg);
    }
    const cameraPoints = content.cameraPath.map(([x, z]) => `${x},${z}`);
    if (new Set(cameraPoints).size > 1) svgElement("polyline", {class: "path", stroke: "currentColor", points: cameraPoints.join(" ")}, svg);
    this.view = svgElement("path", {class: "view"}, svg);
    this.eye = svgElement("circle", {class: "eye", r: 1.3 * this.unit}, svg);
    this.boxes = new Map();
    for (const object of content.objects) if (object.moves) this.boxes.set(object.id, this.box(object, [0, 0, 0, 0], "box", onObject));
    this.scale(x0, z1 + margin, size);
  }

  box(object, bounds, kind, onObject) {
    if (!bounds) return null;
    const box = svgElement("rect", {class: kind, "data-id": object.id}, this.svg);
    if (kind === "box") { box.setAttribute("fill", object.color); box.setAttribute("stroke", object.color); }
    this.place(box, bounds);
    svgElement("title", {}, box).textContent = object.name;
    box.addEventListener("pointerenter", () => onObject(object.id));
    return box;
  }

  place(box, [x0, z0, x1, z1]) {
    for (const [name, value] of Object.entries({x: x0, y: z0, width: x1 - x0, height: z1 - z0})) box.setAttribute(name, value);
  }

  scale(x, y, size) {
    const length = 10 ** Math.floor(Math.log10(size / 2));
    svgElement("path", {d: `M${x},${y} h${length}`, class: "path", stroke: "currentColor"}, this.svg);
    svgElement("text", {x: x + length + this.unit, y: y + 1.4 * this.unit, "font-size": 4.2 * this.unit}, this.svg).textContent = `${length} m`;
  }

  show(frame, selected) {
    for (const object of this.content.objects) {
      const box = this.boxes.get(object.id);
      if (!box) continue;
      const bounds = at(object.bounds, frame);
      box.style.display = bounds ? "" : "none";
      if (bounds) this.place(box, bounds);
    }
    for (const box of this.svg.querySelectorAll("rect")) box.classList.toggle("hit", Number(box.dataset.id) === selected);
    const [x, z, forwardX, forwardZ, halfWidth, isOrthographic] = this.content.cameraPath[frame];
    const length = Math.hypot(forwardX, forwardZ), reach = 22 * this.unit;
    this.eye.setAttribute("cx", x);
    this.eye.setAttribute("cy", z);
    if (length < 0.2) { this.view.removeAttribute("d"); return; }  // it looks straight down or up
    const [dx, dz] = [forwardX / length, forwardZ / length];
    const corner = (distance, sign) => {
      const side = sign * halfWidth * (isOrthographic ? 1 : distance);
      return `${x + dx * distance - dz * side},${z + dz * distance + dx * side}`;
    };
    this.view.setAttribute("d", `M${corner(0, 1)} L${corner(reach, 1)} L${corner(reach, -1)} L${corner(0, -1)} Z`);
  }
}
