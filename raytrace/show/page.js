// The viewer in a page of its own: gives widget.js what a notebook gives it, by requests to the server of this page.

import viewer from "./widget.js";

const PLACE = document.querySelector("main");
const STATUS = document.querySelector("[role=status]");

function ended() {
  STATUS.textContent = "The viewer has ended. Start raytrace view again, and open its address.";
}

// The values of the viewer, as a notebook's model has them.
class Model {
  constructor(state) {
    this.state = state;
    this.changes = {};
    this.handlers = new Map();
    this.last = Promise.resolve(); // requests arrive in their order
  }

  get(name) {
    return this.state[name];
  }

  set(changes) {
    Object.assign(this.state, changes);
    Object.assign(this.changes, changes);
    for (const name of Object.keys(changes)) this.emit(`change:${name}`);
  }

  save_changes() {
    this.post("change", this.changes);
    this.changes = {};
  }

  send(message) {
    this.post("send", message);
  }

  post(name, body) {
    this.last = this.last.then(() => fetch(name, { method: "POST", body: JSON.stringify(body) })).catch(ended);
  }

  on(names, handler) {
    for (const name of names.split(" ")) this.handlers.set(name, [...(this.handlers.get(name) ?? []), handler]);
  }

  off(names, handler) {
    for (const name of names.split(" "))
      this.handlers.set(name, (this.handlers.get(name) ?? []).filter((each) => each !== handler));
  }

  emit(name, ...values) {
    for (const handler of this.handlers.get(name) ?? []) handler(...values);
  }
}

// Waits for messages, one after the other.
async function receive(model) {
  for (let after = 0; ; ) {
    const response = await fetch(`next?after=${after}`);
    if (!response.ok) throw new Error(response.statusText);
    if (response.status === 204) continue;
    const data = await response.arrayBuffer();
    const length = new DataView(data).getUint32(0);
    const { number, content } = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    after = number;
    model.emit("msg:custom", content, [new DataView(data, 4 + length)]);
  }
}

const model = new Model(await (await fetch("state")).json());
viewer.render({ model, el: PLACE });
model.last.then(() => receive(model)).catch(ended); // once the server knows of this page
