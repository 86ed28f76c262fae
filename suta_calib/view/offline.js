// Stands in for viser's server inside a page that has none: hands over the messages that the page
// holds, and answers what is moved and clicked as `Viewer` (server.py) does. Viser's client talks to
// its server through a worker, in objects; here the worker's part is played by `Offline`.
"use strict";

// ── Numbers ─────────────────────────────────────────────────────────────────────────────────────
const product = (A, B) => A.map((row) => B[0].map((_, j) => row.reduce((sum, a, k) => sum + a * B[k][j], 0)));
const transposed = (A) => A[0].map((_, j) => A.map((row) => row[j]));
const turned = (A, v) => A.map((row) => row.reduce((sum, a, k) => sum + a * v[k], 0));
const sum = (a, b) => a.map((value, k) => value + b[k]);

// Rodrigues' formula.
function rotation([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), v = 1 - c;
  return [
    [c + v * x * x, v * x * y - s * z, v * x * z + s * y],
    [v * y * x + s * z, c + v * y * y, v * y * z - s * x],
    [v * z * x - s * y, v * z * y + s * x, c + v * z * z],
  ];
}

// w x y z, from whichever of the four is largest.
function quaternion(R) {
  const [d0, d1, d2] = [R[0][0], R[1][1], R[2][2]];
  const squares = [1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2];
  const k = squares.indexOf(Math.max(...squares)), f = 0.5 / Math.sqrt(squares[k]);
  const [a, b, c] = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]];
  const [p, q, r] = [R[1][0] + R[0][1], R[2][0] + R[0][2], R[2][1] + R[1][2]];
  const rows = [[0, a, b, c], [a, 0, p, q], [b, p, 0, r], [c, q, r, 0]];
  return rows[k].map((value, j) => f * (j === k ? squares[k] : value));
}

// T_base_link of every link at readings q, rad or m: `DrawnArm.poses`.
function poses(arm, q) {
  const joints = [], root = [rotation([0, 0, 1], 0), [0, 0, 0]];
  const within = ([R, p], [turn, place]) => [product(R, turn), sum(p, turned(R, place))];
  arm.parent.forEach((parent, k) => {
    const amount = turned([arm.gearing[k]], q)[0] + arm.shift[k], axis = arm.axis[k];
    const moved = arm.slides[k]
      ? [rotation(axis, 0), axis.map((value) => value * amount)]
      : [rotation(axis, amount), [0, 0, 0]];
    const placed = [arm.rotation[k], arm.position[k]];
    joints.push(within(within(parent < 0 ? root : joints[parent], placed), moved));
  });
  const links = arm.carrier.map((carrier, k) =>
    within(carrier < 0 ? root : joints[carrier], [arm.link_rotation[k], arm.link_position[k]]));
  const [R, p] = links[arm.base], back = transposed(R);
  return links.map(([turn, place]) => [
    product(back, turn), turned(back, sum(place, p.map((value) => -value)))]);
}

// ── Messages ────────────────────────────────────────────────────────────────────────────────────
const update = (name, updates) => ({ type: "SceneNodeUpdateMessage", name, updates, owner: "" });
const set = (uuid, value) => ({ type: "GuiUpdateMessage", uuid, updates: { value } });

function moved(scene, q) {
  return scene.arms.flatMap((arm) => {
    const links = poses(arm, q);
    return [
      ...links.flatMap(([R, p], k) => [
        { type: "SetOrientationMessage", name: arm.nodes[k], wxyz: quaternion(R), owner: "" },
        { type: "SetPositionMessage", name: arm.nodes[k], position: p, owner: "" },
      ]),
      update(arm.chain, { points: new Float32Array(arm.bones.flat().flatMap((k) => links[k][1])) }),
    ];
  });
}

const magnified = (scene, factor) => scene.arrows.map(({ node, at, vector }) => update(node, {
  points: new Float32Array(at.flatMap((begin, k) => [
    ...begin, ...begin.map((value, j) => value + factor * vector[k][j])])),
}));

const inflated = (scene, factor) => scene.ellipsoids.map(({ node, std }) => update(node, {
  batched_scales: new Float32Array(std.flat().map((value) => Math.max(factor * value, 1e-6))),
}));

class Offline {
  constructor({ messages, scene }, say) {
    const { controls } = scene;
    Object.assign(this, { messages, scene, say, controls, shown: 0, q: scene.q, timer: null });
    this.joints = Object.entries(controls.joints);
    this.uuids = {}, this.labels = {};
    for (const { type, uuid, props } of messages) {
      if (type !== "GuiSliderMessage" && type !== "GuiCheckboxMessage") continue;
      this.uuids[props.label] = uuid, this.labels[uuid] = props.label;
    }
  }

  hear({ type, uuid, updates, name, ...clicked }) {
    if (type === "SceneNodeClickMessage" && name === "/samples") {
      const row = clicked.instance_index ?? this.along(clicked.ray_origin, clicked.ray_direction);
      if (row !== null) this.choose(row);
    }
    if (type !== "GuiUpdateMessage" || !("value" in updates)) return;
    const { controls, scene } = this, label = this.labels[uuid], { value } = updates;
    const factor = controls.factors[label], joint = this.joints.findIndex(([each]) => each === label);
    if (factor === "errors") this.say(magnified(scene, value));
    else if (factor === "uncertainty") this.say(inflated(scene, value));
    else if (joint >= 0) {
      this.q = this.q.map((reading, k) => k === joint ? this.joints[k][1] * value : reading);
      this.say(moved(scene, this.q));
    } else if (label in controls.switches) this.say([
      { type: "SetSceneNodeVisibilityMessage", name: controls.switches[label], visible: value, owner: "" }]);
    else if (label === controls.sample) this.show(value);
    else if (label === controls.play) this.play(value);
  }

  // `Rows.along`
  along(origin, [x, y, z]) {
    const off = this.scene.rows.at.map((place) => {
      const [a, b, c] = sum(place, origin.map((value) => -value));
      return Math.hypot(b * z - c * y, c * x - a * z, a * y - b * x);
    });
    const least = Math.min(...off);
    return least <= this.scene.near ? off.indexOf(least) : null;
  }

  show(row) {
    const { rows } = this.scene;
    this.shown = Math.min(row, rows.names.length - 1);
    this.q = rows.q[this.shown];
    const node = "/name of the sample";
    this.say([
      ...moved(this.scene, this.q),
      { type: "SetPositionMessage", name: node, position: rows.at[this.shown], owner: "" },
      update(node, { text: rows.names[this.shown] }),
      ...this.joints.map(([label, factor], k) =>
        set(this.uuids[label], Math.round(100 * this.q[k] / factor) / 100)),
    ]);
  }

  choose(row) {
    this.show(row);
    this.say([set(this.uuids[this.controls.sample], row)]);
  }

  play(on) {
    clearInterval(this.timer);
    const next = () => this.choose((this.shown + 1) % this.scene.rows.names.length);
    if (on) this.timer = setInterval(next, 1000 * this.controls.each_s);
  }
}

// ── What the page holds ─────────────────────────────────────────────────────────────────────────
const ARRAYS = {
  "<f4": Float32Array, "<f8": Float64Array, "|u1": Uint8Array, "<u2": Uint16Array, "<f2": Uint16Array,
  "<u4": Uint32Array, "|i1": Int8Array, "<i2": Int16Array, "<i4": Int32Array,
};

async function held(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(unpacked).arrayBuffer();
  const length = Number(new DataView(buffer).getBigUint64(0, true));
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  let at = 8 + length;
  const places = told.lengths.map((size) => {
    const begin = at + (8 - at % 8) % 8;
    at = begin + size;
    return begin;
  });
  const filled = (value) => {
    if (value === null || typeof value !== "object") return value;
    if (Array.isArray(value)) return value.map(filled);
    const k = value.__binary_index;
    if (k === undefined) return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, filled(each)]));
    const kind = ARRAYS[value.dtype] || Uint8Array;
    return new kind(buffer, places[k], told.lengths[k] / kind.BYTES_PER_ELEMENT);
  };
  return { messages: told.messages.map(filled), scene: told.scene };
}

// The only worker that the page makes of such a scene is the one that connects to the server.
window.Worker = class extends EventTarget {
  postMessage({ type, message }) {
    if (type === "set_server") this.connected = this.connect();
    else if (type === "send") this.connected.then((offline) => offline.hear(message));
  }

  async connect() {
    // The client notes its server in the address, which here is the page itself.
    if (location.protocol === "file:") history.replaceState(null, "", location.pathname);
    const told = await held(document.getElementById("suta-calib-scene").textContent);
    const answer = (data) => this.onmessage({ data });
    const offline = new Offline(told, (messages) => answer({ type: "message_batch", messages }));
    answer({ type: "connected" });
    offline.say(told.messages);
    window.sutaCalibScene = offline;
    return offline;
  }
};
