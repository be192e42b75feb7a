// The browser part of rt.show.live: handles the mouse, keys and sliders, and displays the images that Python renders.

const DEGREES = 0.5; // rotation per pixel of dragging
const STEP = 5; // degrees per arrow key
const ZOOM = 0.0015; // natural logarithm of the distance factor, per unit of the wheel
const DISTANCES = [0.1, 10]; // limits of the distance factor
const CLICK = 4; // pixels: a shorter drag is a click
const AHEAD = 2; // requests in flight: one image is rendered while the other is sent and displayed
const TIMEOUT = 2000; // ms after which a missing image is no longer waited for
const LARGE = 512; // approximate size of the longer side of the canvas, CSS pixels
const MOST = [32, 4096]; // limits of the scale at rest, and of the longer side of the image then
const FRAMES = 16; // images during a drag over which the frame rate is averaged
const PAUSE = 400; // ms without a new image after which a drag is over

function element(kind, parent, properties = {}) {
  const made = Object.assign(document.createElement(kind), properties);
  parent.append(made);
  return made;
}

// Sends changes to Python while fewer than AHEAD requests are in flight: no queue builds up, and no image is outdated.
class ChangeSender {
  constructor(model) {
    this.model = model;
    this.changes = null;
    this.sent = this.shown = model.get("turn"); // newest turn that was sent, and the newest whose image has arrived
  }

  set(changes) {
    this.changes = { ...this.changes, ...changes };
    this.flush();
  }

  // the newest value of a control, sent or not
  get(name) {
    return this.changes?.[name] ?? this.model.get(name);
  }

  moving() {
    return this.changes !== null || this.shown < this.sent;
  }

  flush() {
    if (this.changes === null || this.sent - this.shown >= AHEAD) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.arrived(this.sent), TIMEOUT);
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

function slider(controls, sender, { label, low, high, step, read, write, format }) {
  const row = element("label", controls, { textContent: label });
  const input = element("input", row, { type: "range", min: low, max: high, step }); // first child: the label refers to it
  const output = element("output", row);
  input.oninput = () => {
    sender.set(write(Number(input.value)));
    output.value = format();
  };
  return () => {
    input.value = read();
    output.value = format();
  };
}

function checkbox(controls, sender, { label, name }) {
  const row = element("label", controls, { className: "check" });
  const input = element("input", row, { type: "checkbox" });
  element("span", row, { textContent: label });
  input.onchange = () => sender.set({ [name]: input.checked });
  return () => {
    input.checked = sender.get(name);
  };
}

function sliders(controls, sender, model) {
  const made = [];
  const add = (options) => made.push(slider(controls, sender, options));
  if (model.get("lights") > 0)
    add({
      label: "light", low: -4, high: 4, step: 0.05, // powers of two
      read: () => Math.log2(sender.get("power")),
      write: (stops) => ({ power: 2 ** stops }),
      format: () => `× ${sender.get("power").toPrecision(3)}`,
    });
  for (const [name, ior] of Object.entries(model.get("ior")))
    add({
      label: `index of ${name}`, low: Math.min(0.4, ior), high: Math.max(2.6, ior), step: 0.01,
      read: () => sender.get("ior")[name],
      write: (value) => ({ ior: { ...sender.get("ior"), [name]: value } }),
      format: () => sender.get("ior")[name].toFixed(2),
    });
  add({
    label: "samples per pixel", low: 0, high: 10, step: 1,
    read: () => Math.log2(sender.get("spp")),
    write: (power) => ({ spp: 2 ** power }),
    format: () => `${sender.get("spp")}`,
  });
  return made;
}

// Drag to rotate, wheel to zoom, click to choose a pixel; or arrow keys, + and -.
function listen(canvas, sender, limits, choose) {
  const within = (value, [low, high]) => Math.min(Math.max(value, low), high);
  const turn = (right, up) =>
    sender.set({ azimuth: sender.get("azimuth") + right, elevation: within(sender.get("elevation") + up, limits) });
  const move = (logarithm) =>
    sender.set({ distance: within(sender.get("distance") * Math.exp(logarithm), DISTANCES) });
  let dragged = 0; // pixels since the button was pressed
  canvas.onpointerdown = (event) => {
    dragged = 0;
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    dragged += Math.abs(event.movementX) + Math.abs(event.movementY);
    if (dragged > CLICK) turn(-DEGREES * event.movementX, DEGREES * event.movementY);
  };
  canvas.onpointerup = (event) => {
    if (dragged <= CLICK) choose(event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight);
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
    event.stopPropagation(); // otherwise the notebook would select another cell
    keys[event.key]();
  };
}

// Handles of lights on the image. Dragging one moves its light in a plane that is parallel to the image.
function lightHandles(view, canvas, sender, code) {
  const first = sender.model.get("light_positions");
  const made = first.map((_, k) => {
    const handle = element("div", view, { className: "light", hidden: true, title: `light ${k + 1}: drag to move it` });
    handle.onpointerdown = (event) => handle.setPointerCapture(event.pointerId);
    handle.onpointermove = (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const box = canvas.getBoundingClientRect(), { at, right, down } = handle.place;
      const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
      const from = handle.from[k].map((value, axis) => value + (x - at[0]) * right[axis] + (y - at[1]) * down[axis]);
      const positions = sender.get("light_positions").map((position, j) => (j === k ? from : position));
      put(handle, [x, y]);
      sender.set({ light_positions: positions });
    };
    return handle;
  });
  const put = (handle, [x, y]) => Object.assign(handle.style, { left: `${100 * x}%`, top: `${100 * y}%` });
  const held = (handle) => handle.matches(":active");
  return {
    place(handles) {
      if (sender.moving() || made.some(held)) return; // the positions of older images
      made.forEach((handle, k) => {
        const { at } = handles[k];
        handle.hidden = at === null || Math.min(...at) < 0 || Math.max(...at) > 1;
        Object.assign(handle, { place: handles[k], from: sender.get("light_positions") });
        if (!handle.hidden) put(handle, at);
      });
    },
    show() {
      const number = (value) => Number(value.toPrecision(5));
      const changed = sender.get("light_positions").flatMap((position, k) =>
        position.every((value, axis) => value === sender.model.get("first_light_positions")[k][axis])
          ? [] : [`light ${k + 1}: "position": [${position.map(number).join(", ")}]`]);
      code.textContent = changed.join("\n");
    },
  };
}

// Asks for as many pixels at rest as the screen shows. No change of the scene: no turn.
function follow(canvas, model, [width, height]) {
  const resize = () => {
    const most = Math.min(MOST[0], Math.floor(MOST[1] / Math.max(width, height)));
    const wanted = Math.ceil((canvas.clientWidth * window.devicePixelRatio) / width - 0.01);
    const scale = Math.max(Math.min(wanted, most), 1);
    if (canvas.clientWidth === 0 || scale === model.get("scale")) return;
    model.set({ scale });
    model.save_changes();
  };
  const observer = new ResizeObserver(resize);
  observer.observe(canvas);
  resize();
  return () => observer.disconnect();
}

function render({ model, el }) {
  const [width, height] = model.get("size");
  const scale = Math.max(Math.round(LARGE / Math.max(width, height)), 1);
  const root = element("div", el, { className: "raytrace-viewer" });
  const main = element("div", root, { className: "main" });
  const view = element("div", main, { className: "view" });
  const canvas = element("canvas", view, { width, height, tabIndex: 0, title: model.get("about") });
  canvas.style.width = `${scale * width}px`;
  const mark = element("div", view, { className: "mark", hidden: true });
  const controls = element("div", main, { className: "controls" });
  const path = element("div", root, { className: "path" });

  const sender = new ChangeSender(model);
  const shown = sliders(controls, sender, model);
  shown.push(checkbox(controls, sender, { label: "hide walls seen from behind", name: "hide_backs" }));
  const reset = element("button", controls, { textContent: "Reset" });
  const status = element("div", controls, { className: "status" });
  element("div", controls, { className: "note", textContent: "Drag to rotate, wheel to zoom, click a pixel to show its path." });
  const update = () => {
    if (sender.changes === null) shown.forEach((show) => show());
  };
  const lights = lightHandles(view, canvas, sender, element("code", controls, { className: "changes" }));
  shown.push(lights.show);
  const first = {
    azimuth: 0, elevation: 0, distance: 1, power: 1, ior: model.get("first_ior"),
    light_positions: model.get("first_light_positions"),
  };
  reset.onclick = () => {
    sender.set(first);
    update();
  };
  listen(canvas, sender, model.get("elevation_limits"), (right, down) => {
    const across = width * model.get("scale"), along = height * model.get("scale");
    const pixel = [Math.floor(right * across), Math.floor(down * along)];
    mark.style.left = `${(100 * (pixel[0] + 0.5)) / across}%`;
    mark.style.top = `${(100 * (pixel[1] + 0.5)) / along}%`;
    mark.hidden = false;
    path.textContent = `tracing pixel (${pixel[0]}, ${pixel[1]}) ...`;
    model.send({ kind: "path", pixel });
  });

  const times = []; // ms: times of the last images during a drag
  const paint = async ({ type, samples, turn, handles }, data) => {
    const bitmap = await createImageBitmap(new Blob([data], { type }));
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height)
      Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    const now = performance.now(), moving = sender.moving();
    if (now - times.at(-1) > PAUSE) times.length = 0;
    if (moving) times.push(now);
    if (!moving || times.length === FRAMES) {
      status.textContent = `${samples < 10 ? samples.toFixed(1) : Math.round(samples)} samples per pixel, ${bitmap.width} × ${bitmap.height}`;
      if (moving) status.textContent += `, ${Math.round((1000 * (FRAMES - 1)) / (now - times[0]))} frames/s`;
      times.length = 0;
    }
    canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + (turn > sender.shown); // images that answer a change
    Object.assign(canvas.dataset, { samples, turn, type });
    sender.arrived(turn);
    lights.place(handles);
    update();
  };
  let last = Promise.resolve(); // images are painted in the order of their arrival
  const receive = (message, buffers) => {
    if (message.kind === "frame") last = last.then(() => paint(message, buffers[0]));
    if (message.kind === "path") path.innerHTML = message.html;
    if (message.kind === "error") status.textContent = path.textContent = message.text;
  };
  const moved = () => {
    if (!mark.hidden) mark.hidden = true;
  };
  const camera = "change:azimuth change:elevation change:distance", values = "change:power change:ior change:spp change:hide_backs change:light_positions";
  model.on("msg:custom", receive);
  model.on(camera, moved);
  model.on(values, update);
  update();
  const unfollow = follow(canvas, model, [width, height]);
  model.send({ kind: "render" });
  return () => {
    unfollow();
    model.off("msg:custom", receive);
    model.off(camera, moved);
    model.off(values, update);
  };
}

export default { render };
