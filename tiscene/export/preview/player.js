// The page: frames, buffers, cursor, objects.

const content = JSON.parse(document.getElementById("content").textContent);
const $ = (id) => document.getElementById(id);
const count = content.frames.length, size = content.width * content.height;
const objects = new Map(content.objects.map((object) => [object.id, object]));
const state = {frame: 0, camera: 0, shown: null, pixel: null, pinned: false, selected: 0, sort: "pixels", playing: 0};
const tiles = new Map();

// A cache of promises by key that forgets the least recently used.
class Cache {
  constructor(limit) { this.limit = limit; this.kept = new Map(); }
  get(key, make) {
    const found = this.kept.get(key) ?? make();
    this.kept.delete(key);
    this.kept.set(key, found);
    if (this.kept.size > this.limit) {
      const [oldest] = this.kept.keys();
      this.kept.get(oldest).then((old) => old.close?.());
      this.kept.delete(oldest);
    }
    return found;
  }
}
const room = Math.max(4 * content.buffers.length, Math.floor(3e8 / (4 * size)));
const pictures = new Cache(room), values = new Cache(room);

function pictureOf(name, frame) {
  return pictures.get(`${state.camera} ${name} ${frame}`, () =>
    createImageBitmap(new Blob([bytesOf(content.cameras[state.camera].pictures[name][frame])], {type: "image/webp"})));
}

function valuesOf(buffer, frame) {
  return values.get(`${state.camera} ${buffer.name} ${frame}`, () =>
    decodePlanes(content.cameras[state.camera].values[buffer.name][frame], buffer.planes, content.width, content.height,
      () => valuesOf(buffer, frame - 1)));
}

function nameOf(buffer, id) {
  if (!id) return "0 background";
  if (buffer === "semantic") return `${id} ${content.categories[id] ?? ""}`;
  if (buffer === "material_coverage") return `${id} ${content.materials[id] ?? ""}`;
  if (buffer === "part") return String(id);
  return `${id} ${objects.get(id)?.name ?? ""}`;
}

function makeTiles() {
  for (const [number, buffer] of content.buffers.entries()) {
    const tile = document.createElement("div");
    tile.className = "tile";
    tile.innerHTML = '<div class="stack"><canvas></canvas><canvas></canvas><div class="cross" hidden></div></div><div class="name"><b></b><span></span></div>';
    const [canvas, overlay] = tile.querySelectorAll("canvas");
    for (const each of [canvas, overlay]) { each.width = content.width; each.height = content.height; }
    canvas.dataset.buffer = buffer.name;
    tile.querySelector("b").textContent = buffer.name;
    tile.querySelector("b").title = buffer.doc;
    tile.querySelector(".name span").textContent = buffer.caption;
    tiles.set(buffer.name, {tile, canvas, overlay, cross: tile.querySelector(".cross")});
    $("tiles").append(tile);
    const stack = tile.querySelector(".stack");
    stack.addEventListener("pointermove", (event) => { if (!state.pinned) setPixel(pixelAt(stack, event)); });
    stack.addEventListener("pointerleave", () => { if (!state.pinned) setPixel(null); });
    stack.addEventListener("click", (event) => { state.pinned = true; setPixel(pixelAt(stack, event)); });
    addTab(buffer.name, number + 1);
  }
  addTab(null, 0);
}

function addTab(name, number) {
  const tab = document.createElement("button");
  tab.type = "button";
  tab.role = "tab";
  tab.textContent = name ?? "all";
  if (number < 10) tab.title = `key ${number}`;
  tab.dataset.tab = name ?? "";
  tab.addEventListener("click", () => choose(name));
  name ? $("tabs").append(tab) : $("tabs").prepend(tab);
}

function choose(name) {
  state.shown = name;
  for (const tab of $("tabs").children) tab.setAttribute("aria-selected", String(tab.dataset.tab === (name ?? "")));
  for (const [buffer, {tile}] of tiles) tile.hidden = name !== null && buffer !== name;
  const columns = name === null ? Math.min(3, content.buffers.length) : 1;
  $("tiles").style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
  show(state.frame);
}

function pixelAt(stack, event) {
  const box = stack.getBoundingClientRect();
  const x = Math.floor((event.clientX - box.left) / box.width * content.width);
  const y = Math.floor((event.clientY - box.top) / box.height * content.height);
  return [Math.min(Math.max(x, 0), content.width - 1), Math.min(Math.max(y, 0), content.height - 1)];
}

async function show(frame) {
  state.frame = frame;
  $("slider").value = frame;
  const index = content.frames[frame];
  $("clock").textContent = `frame ${index} · ${(index / content.fps).toFixed(2)} s`;
  plan.show(frame, state.selected);
  for (const chart of charts) chart.show(frame);
  const visible = content.buffers.filter(({name}) => !tiles.get(name).tile.hidden);
  const drawn = visible.map(async ({name}) => {
    const bitmap = await pictureOf(name, frame);
    if (state.frame === frame) tiles.get(name).canvas.getContext("2d").drawImage(bitmap, 0, 0);
  });
  await Promise.all(drawn);
  if (state.frame !== frame) return;  // a later frame has overtaken this one
  showEvents();
  showObjects();
  await showPixel();
  if (state.frame === frame) document.body.dataset.shown = frame;
}

function setPixel(pixel) {
  state.pixel = pixel;
  showPixel();
}

async function showPixel() {
  const {frame, pixel} = state;
  for (const {cross} of tiles.values()) {
    cross.hidden = pixel === null;
    if (pixel === null) continue;
    const [x, y] = pixel, percent = (value, whole) => `${100 * value / whole}%`;
    Object.assign(cross.style, {left: percent(x, content.width), top: percent(y, content.height), width: percent(1, content.width), height: percent(1, content.height)});
  }
  $("pixel").textContent = pixel === null ? "" : `x ${pixel[0]}, y ${pixel[1]}${state.pinned ? ", kept" : ""}`;
  const rows = content.buffers.filter((buffer) => buffer.planes);
  const decoded = pixel === null ? [] : await Promise.all(rows.map((buffer) => valuesOf(buffer, frame)));
  if (state.frame !== frame || state.pixel !== pixel) return;  // a later event has overtaken this one
  const lines = rows.map((buffer, row) => {
    const text = pixel === null ? "" : valueText(buffer, decoded[row], pixel[1] * content.width + pixel[0], size, nameOf);
    const line = document.createElement("tr");
    line.append(cell("th", buffer.name), cell("td", text));
    line.lastChild.dataset.value = buffer.name;
    return line;
  });
  $("readout").tBodies[0].replaceChildren(...lines);
  document.body.dataset.pixel = pixel === null ? "" : `${frame} ${pixel}`;
  const row = rows.findIndex(({name}) => name === "instance");
  if (pixel !== null && row >= 0) await select(decoded[row][pixel[1] * content.width + pixel[0]]);
}

// Select an object: outline it in all buffers, mark it in the table and in the plan, and draw its pixels over time.
async function select(id) {
  if (id !== state.selected) {
    state.selected = id;
    const object = objects.get(id);
    const pixels = object ? content.frames.map((_, frame) => at(object.pixels, frame)) : [];
    charts.at(-1).set(object ? `pixels of ${object.name}` : "pixels of the selected object", pixels);
    charts.at(-1).show(state.frame);
    plan.show(state.frame, id);
  }
  for (const line of $("objects").querySelectorAll("tbody tr")) line.classList.toggle("hit", Number(line.dataset.id) === id);
  await outline();
}

async function outline() {
  const buffer = content.buffers.find(({name}) => name === "instance"), {frame, selected} = state;
  if (!buffer) return;
  const ids = selected ? await valuesOf(buffer, frame) : null;
  if (state.frame !== frame || state.selected !== selected) return;
  const image = new ImageData(content.width, content.height), {width, height} = content;
  for (let i = 0; ids && i < size; i++) {
    if (ids[i] !== selected) continue;
    const x = i % width, inside = x && x < width - 1 && i >= width && i < size - width &&
      ids[i - 1] === selected && ids[i + 1] === selected && ids[i - width] === selected && ids[i + width] === selected;
    if (!inside) image.data.set([255, 161, 92, 230], 4 * i);
  }
  for (const {overlay} of tiles.values()) overlay.getContext("2d").putImageData(image, 0, 0);
}

function cell(kind, text) {
  const element = document.createElement(kind);
  element.textContent = text;
  return element;
}

function showEvents() {
  const name = (id) => objects.get(id)?.name ?? `object ${id}`;
  $("events").replaceChildren(...content.events[state.frame].map((event) =>
    cell("li", `${event.kind}: ${name(event.object)}${event.other ? ` – ${name(event.other)}` : event.surface ? ` – ${event.surface}` : ""}`)));
}

function showObjects() {
  const {frame, sort} = state;
  const value = (object) => (Array.isArray(object[sort]) ? at(object[sort], frame) : object[sort]);
  const living = content.objects.filter((object) => at(object.positions, frame) && ($("all").checked || at(object.pixels, frame)));
  living.sort((a, b) => (typeof value(a) === "string" ? value(a).localeCompare(value(b)) : value(b) - value(a)) || a.id - b.id);
  if (sort === "id") living.sort((a, b) => a.id - b.id);
  $("objects").querySelector("tbody").replaceChildren(...living.map((object) => {
    const line = document.createElement("tr"), swatch = document.createElement("i");
    line.dataset.id = object.id;
    line.classList.toggle("hit", object.id === state.selected);
    swatch.className = "swatch";
    swatch.style.background = object.color;
    const first = document.createElement("td");
    first.append(swatch);
    const position = at(object.positions, frame).map((x) => x.toFixed(2)).join(", ");
    const name = cell("td", object.name);
    name.className = "name";
    name.title = object.template ? `template ${object.template}` : "";
    line.append(first, cell("td", object.id), name, cell("td", object.category), cell("td", at(object.pixels, frame)),
      cell("td", `${Math.round(100 * at(object.visibility, frame))} %`), cell("td", position), cell("td", at(object.speeds, frame).toFixed(2)));
    line.addEventListener("click", () => select(object.id));
    return line;
  }));
  outline();
}

function play(on) {
  clearInterval(state.playing);
  const step = () => { if (document.body.dataset.shown === String(state.frame)) show((state.frame + 1) % count); };
  state.playing = on ? setInterval(step, 1000 / content.fps) : 0;
  $("play").textContent = on ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", on ? "stop" : "play");
}

function goTo(frame) {
  play(false);
  return show(Math.min(Math.max(frame, 0), count - 1));
}

function toggleTheme() {
  document.documentElement.classList.toggle("dark");
}

function toggleKeys() {
  $("keys").hidden = !$("keys").hidden;
  $("help").setAttribute("aria-expanded", String(!$("keys").hidden));
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  const far = event.shiftKey ? 10 : 1, actions = {
    " ": () => play(!state.playing), ArrowLeft: () => goTo(state.frame - far), ArrowRight: () => goTo(state.frame + far),
    Home: () => goTo(0), End: () => goTo(count - 1), t: toggleTheme, T: toggleTheme, "?": toggleKeys, 0: () => choose(null),
    Escape: () => { state.pinned = false; setPixel(null); select(0); },
  };
  const number = Number(event.key);
  const action = actions[event.key] ?? (number && number <= content.buffers.length ? () => choose(content.buffers[number - 1].name) : null);
  if (!action) return;
  event.preventDefault();
  action();
}

const length = count === 1 ? "1 frame" : `${count} frames`;
$("scene").textContent = content.scene;
$("summary").textContent = `${content.width} × ${content.height} px · ${length} · ${content.fps} frames/s`;
$("slider").max = count - 1;
$("slider").addEventListener("input", () => goTo(Number($("slider").value)));
$("play").addEventListener("click", () => play(!state.playing));
$("theme").addEventListener("click", toggleTheme);
$("help").addEventListener("click", toggleKeys);
$("all").addEventListener("change", showObjects);
for (const head of document.querySelectorAll("th[data-key]")) {
  head.addEventListener("click", () => { state.sort = head.dataset.key; showObjects(); });
}
document.addEventListener("keydown", onKey);
if (matchMedia("(prefers-color-scheme: dark)").matches) toggleTheme();
for (const [frame, events] of content.events.entries()) {
  if (!events.length) continue;
  const tick = document.createElement("i");
  tick.style.left = `${100 * frame / Math.max(count - 1, 1)}%`;
  $("ticks").append(tick);
}
if (content.cameras.length > 1) {
  $("camera").hidden = false;
  $("camera").append(...content.cameras.map(({name}) => cell("option", name)));
  $("camera").addEventListener("change", () => { state.camera = $("camera").selectedIndex; show(state.frame); });
}
const plan = new Plan($("plan"), content, (id) => { if (!state.pinned) select(id); });
const charts = Object.entries(content.difficulty).map(([name, series]) => new Chart($("charts"), MEASURES[name], series, goTo));
charts.push(new Chart($("charts"), "pixels of the selected object", [], goTo));
makeTiles();
choose(null);
