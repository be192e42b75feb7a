// The browser's half of rt.show.live: a hand on the picture and on sliders; Python draws.

const DEGREES = 0.5; // a pixel of the hand's way
const STEP = 5; // degrees, an arrow key
const ZOOM = 0.0015; // of the wheel's way, natural logarithm of distance
const DISTANCES = [0.1, 10]; // of the scene's own
const CLICK = 4; // pixels of the hand's way that are still a click
const AHEAD = 2; // pictures on their way: one is drawn while the other one is sent and shown
const PATIENCE = 2000; // ms until a picture that doesn't come is waited for no more
const LARGE = 512; // pixels of the screen that the longer side of the picture takes, about
const MANY = 16; // pictures of a hand that moves by which their pace is told
const PAUSE = 400; // ms without a new picture after which a hand rests

function element(kind, parent, properties = {}) {
  const made = Object.assign(document.createElement(kind), properties);
  parent.append(made);
  return made;
}

// Sends what has changed, but only while few pictures are still on their way: no queue builds up, and none is stale.
class Line {
  constructor(model) {
    this.model = model;
    this.changes = null;
    this.sent = this.shown = model.get("turn"); // newest turn that was sent, and whose picture is here
  }

  set(changes) {
    this.changes = { ...this.changes, ...changes };
    this.flush();
  }

  // the newest value of a knob, sent or not
  get(name) {
    return this.changes?.[name] ?? this.model.get(name);
  }

  moving() {
    return this.changes !== null || this.shown < this.sent;
  }

  flush() {
    if (this.changes === null || this.sent - this.shown >= AHEAD) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.arrived(this.sent), PATIENCE);
    this.sent = this.model.get("turn") + 1;
    this.model.set({ ...this.changes, turn: this.sent });
    this.changes = null;
    this.model.save_changes();
  }

  arrived(turn) {
    this.shown = Math.max(this.shown, turn);
    this.flush();
  }
}

function slider(knobs, line, { label, low, high, step, read, write, tell }) {
  const row = element("label", knobs, { textContent: label });
  const input = element("input", row, { type: "range", min: low, max: high, step }); // first: it is what is labelled
  const output = element("output", row);
  input.oninput = () => {
    line.set(write(Number(input.value)));
    output.value = tell();
  };
  return () => {
    input.value = read();
    output.value = tell();
  };
}

function sliders(knobs, line, model) {
  const made = [];
  const add = (options) => made.push(slider(knobs, line, options));
  if (model.get("lights") > 0)
    add({
      label: "light", low: -4, high: 4, step: 0.05, // powers of two
      read: () => Math.log2(line.get("power")),
      write: (stops) => ({ power: 2 ** stops }),
      tell: () => `× ${line.get("power").toPrecision(3)}`,
    });
  for (const [name, ior] of Object.entries(model.get("ior")))
    add({
      label: `index of ${name}`, low: Math.min(0.4, ior), high: Math.max(2.6, ior), step: 0.01,
      read: () => line.get("ior")[name],
      write: (value) => ({ ior: { ...line.get("ior"), [name]: value } }),
      tell: () => line.get("ior")[name].toFixed(2),
    });
  add({
    label: "samples a pixel", low: 0, high: 10, step: 1,
    read: () => Math.log2(line.get("spp")),
    write: (power) => ({ spp: 2 ** power }),
    tell: () => `${line.get("spp")}`,
  });
  return made;
}

// Drag to turn, wheel to come nearer, click to choose a pixel; or arrow keys, + and -.
function listen(canvas, line, reach, choose) {
  const within = (value, [low, high]) => Math.min(Math.max(value, low), high);
  const turn = (right, up) =>
    line.set({ azimuth: line.get("azimuth") + right, elevation: within(line.get("elevation") + up, reach) });
  const move = (logarithm) =>
    line.set({ distance: within(line.get("distance") * Math.exp(logarithm), DISTANCES) });
  let way = 0; // of the hand since it went down
  canvas.onpointerdown = (event) => {
    way = 0;
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    way += Math.abs(event.movementX) + Math.abs(event.movementY);
    if (way > CLICK) turn(-DEGREES * event.movementX, DEGREES * event.movementY);
  };
  canvas.onpointerup = (event) => {
    if (way <= CLICK) choose(event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move(ZOOM * event.deltaY);
  }, { passive: false });
  const keys = {
    ArrowLeft: () => turn(-STEP, 0), ArrowRight: () => turn(STEP, 0),
    ArrowUp: () => turn(0, STEP), ArrowDown: () => turn(0, -STEP),
    "+": () => move(-0.1), "-": () => move(0.1),
  };
  canvas.onkeydown = (event) => {
    if (!(event.key in keys)) return;
    event.preventDefault();
    event.stopPropagation(); // the notebook would move to another cell
    keys[event.key]();
  };
}

function render({ model, el }) {
  const [width, height] = model.get("size");
  const scale = Math.max(Math.round(LARGE / Math.max(width, height)), 1);
  const root = element("div", el, { className: "raytrace-viewer" });
  const hand = element("div", root, { className: "hand" });
  const picture = element("div", hand, { className: "picture" });
  const canvas = element("canvas", picture, { width, height, tabIndex: 0, title: model.get("about") });
  canvas.style.width = `${scale * width}px`;
  canvas.style.height = `${scale * height}px`;
  const mark = element("div", picture, { className: "mark", hidden: true });
  const knobs = element("div", hand, { className: "knobs" });
  const path = element("div", root, { className: "path" });

  const line = new Line(model);
  const shown = sliders(knobs, line, model);
  const reset = element("button", knobs, { textContent: "as in the file" });
  const status = element("div", knobs, { className: "status" });
  element("div", knobs, { className: "note", textContent: "Drag to turn, wheel to zoom, click for a pixel's path." });
  const update = () => {
    if (line.changes === null) shown.forEach((show) => show());
  };
  const first = { azimuth: 0, elevation: 0, distance: 1, power: 1, ior: model.get("first_ior") };
  reset.onclick = () => {
    line.set(first);
    update();
  };
  listen(canvas, line, model.get("reach"), (right, down) => {
    const pixel = [Math.floor(right * width), Math.floor(down * height)];
    mark.style.left = `${scale * (pixel[0] + 0.5)}px`;
    mark.style.top = `${scale * (pixel[1] + 0.5)}px`;
    mark.hidden = false;
    path.textContent = `following pixel (${pixel[0]}, ${pixel[1]}) ...`;
    model.send({ kind: "path", pixel });
  });

  const times = []; // ms: of the last pictures of a hand that moves
  const paint = async ({ type, samples, turn }, data) => {
    const bitmap = await createImageBitmap(new Blob([data], { type }));
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    const now = performance.now(), moving = line.moving();
    if (now - times.at(-1) > PAUSE) times.length = 0;
    if (moving) times.push(now);
    if (!moving || times.length === MANY) {
      status.textContent = `${samples < 10 ? samples.toFixed(1) : Math.round(samples)} samples a pixel`;
      if (moving) status.textContent += `, ${Math.round((1000 * (MANY - 1)) / (now - times[0]))} frames/s`;
      times.length = 0;
    }
    canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + (turn > line.shown); // that followed the hand
    Object.assign(canvas.dataset, { samples, turn, type });
    line.arrived(turn);
  };
  let last = Promise.resolve(); // pictures are painted in the order in which they come
  const hear = (message, buffers) => {
    if (message.kind === "frame") last = last.then(() => paint(message, buffers[0]));
    if (message.kind === "path") path.innerHTML = message.html;
    if (message.kind === "trouble") status.textContent = path.textContent = message.text;
  };
  const moved = () => {
    if (!mark.hidden) mark.hidden = true;
  };
  const places = "change:azimuth change:elevation change:distance", values = "change:power change:ior change:spp";
  model.on("msg:custom", hear);
  model.on(places, moved);
  model.on(values, update);
  update();
  model.send({ kind: "draw" });
  return () => {
    model.off("msg:custom", hear);
    model.off(places, moved);
    model.off(values, update);
  };
}

export default { render };
