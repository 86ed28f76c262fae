"use strict";
let framed = false, wrongBefore = "", takenBefore = null, takenAt = 0, takenName = "";

addEventListener("keydown", event => {
  const key = {Enter: "take", r: "retake", s: "skip", q: "stop"}[event.key];
  if (key && state.phase === "measuring" && event.target.tagName !== "BUTTON") press(key);
});

const statusOf = ([name, status, doubt]) => status === "next" ? "next" : doubt ? "doubted" : status;
const words = {
  taken: "measured", next: "next", doubted: "does not fit", skipped: "skipped", open: "not yet measured",
};

function drawNow() {
  const measuring = state.phase === "measuring", rows = state.stations || [];
  const next = rows.find(row => row[1] === "next"), live = state.live || {};
  const done = rows.filter(row => row[1] === "taken").length;
  put("title", state.title + (state.label ? " · " + state.label : ""));
  put("count", rows.length ? `${done} of ${rows.length}` : "");
  const silent = measuring && live.silence > 1;
  put("ask", !measuring ? {calibrating: "", between: "", done: "", lost: "The device is not there"}[state.phase] ?? "Connecting"
    : silent ? "" : next ? "Bring the tip to" : "");
  const name = measuring ? (silent ? "No readings" : next ? next[0] : "") : state.phase === "lost" ? "" : state.headline || "";
  put("name", state.phase === "done" ? "" : name);
  $("name").classList.toggle("long", name.length > 4);
  put("how", measuring && !silent ? state.how : state.phase === "lost" ? state.headline : "");
  let doing = "";
  if (measuring) {
    if (silent) doing = `for ${live.silence.toFixed(0)} s. Check the cable: nothing is lost, and it goes on by itself.`;
    else if (!live.readings) doing = "Waiting for readings";
    else if (Date.now() - takenAt < 1800 && !state.alert) doing = `${takenName} is measured ✓`;
    else if (!live.resting) doing = "Moving";
    else doing = live.share < 1 ? "Hold still" : state.alert ? `Seat ${state.alert.name} again` : next ? `Go to ${next[0]}` : "";
  }
  if (state.phase === "calibrating") doing = "This takes a few seconds to a minute.";
  put("doing", doing);
  $("doing").style.fontSize = silent || doing.length > 30 ? "1.6rem" : "";
  $("rest").hidden = !measuring || silent;
  const bar = $("rest").firstChild;
  bar.style.width = 100 * (live.share || 0) + "%"; bar.className = live.share >= 1 ? "full" : "";
  const alert = measuring && !silent && state.alert;
  $("alert").hidden = !alert;
  if (alert) { $("alert").firstChild.textContent = alert.title; $("alert").lastChild.textContent = alert.text; }
  const just = Date.now() - takenAt < 1800;
  $("now").className = !measuring ? "" : silent || alert ? "wrong" : just ? "taken" : live.resting && live.share < 1 ? "hold" : "";
}
function drawPlaces() {
  const rows = state.stations || [], kinds = Object.fromEntries(rows.map(row => [row[0], statusOf(row)]));
  $("chips").replaceChildren(...rows.map(row => {
    const chip = element("li", row[0], statusOf(row));
    chip.title = words[statusOf(row)] + (row[2] ? ": " + row[2] : "");
    return chip;
  }));
  const map = $("map"), marks = state.map || [];
  map.toggleAttribute("hidden", !marks.length);
  if (!marks.length) return;
  const xs = marks.map(mark => mark[1]), ys = marks.map(mark => -mark[2]);
  const low = [Math.min(...xs), Math.min(...ys)], size = [Math.max(...xs) - low[0], Math.max(...ys) - low[1]];
  const unit = Math.max(...size, 1) / 100, edge = 12 * unit;
  map.setAttribute("viewBox", [low[0] - edge, low[1] - edge, size[0] + 2 * edge, size[1] + 2 * edge].join(" "));
  const svg = tag => document.createElementNS("http://www.w3.org/2000/svg", tag);
  map.replaceChildren(...marks.map(([name, x, y]) => {
    const group = svg("g"), circle = svg("circle"), label = svg("text");
    group.setAttribute("class", kinds[name] || "");
    circle.setAttribute("cx", x); circle.setAttribute("cy", -y); circle.setAttribute("r", 3 * unit);
    label.setAttribute("x", x); label.setAttribute("y", -y - 5 * unit); label.setAttribute("font-size", 7 * unit);
    label.textContent = name;
    group.append(circle, label);
    return group;
  }));
}
function drawKnown() {
  const known = state.determined;
  if (!known) return;
  put("tip", `Tip ${known.tip}`);
  put("worst", `worst: ${known.worst}; from ${known.samples} samples`);
  $("parameters").replaceChildren(...known.parameters.flatMap(({name, text, share}) => {
    const bar = element("div", undefined, "bar"), fill = element("i");
    fill.style.width = 100 * share + "%"; if (share >= 1) fill.className = "full";
    bar.append(fill); bar.setAttribute("role", "meter"); bar.setAttribute("aria-valuenow", share); bar.setAttribute("aria-label", name);
    return [element("span", name), bar, element("span", text)];
  }));
}
function drawPlan() {
  const plan = state.plan;
  $("plan").hidden = !plan || state.phase !== "between";
  if (!plan) return;
  if (plan.waiting) $("plan").replaceChildren(element("p", "Looking for the best place to measure next …"));
  else $("plan").replaceChildren(element("b", plan.head), element("p", plan.why));
}
const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => { if (framed) { framed = false; drawScene(); } });
function drawScene() {
  if (framed) return;
  framed = true;
  const frame = element("iframe");
  frame.title = "The arm in 3-D";
  frame.src = "scene/" + (dark.matches ? "?darkMode" : "");
  frame.onload = () => {
    // Of viser's page, the scene alone.
    const style = frame.contentDocument.createElement("style");
    style.textContent = "body * { visibility: hidden !important; } canvas { visibility: visible !important; }";
    frame.contentDocument.head.append(style);
  };
  $("scene").replaceChildren(frame);
}
function heard(news) {
  if (news.stations) {
    const taken = news.stations.filter(row => row[1] === "taken").map(row => row[0]);
    if (takenBefore && taken.length > takenBefore.length) {
      takenName = taken.find(name => !takenBefore.includes(name)); takenAt = Date.now();
      setTimeout(drawNow, 1900);
      if (!(news.alert || state.alert)) beep(880);
    }
    takenBefore = taken;
  }
  const wrong = state.alert ? state.alert.title : "";
  if (wrong && wrong !== wrongBefore) beep(330, 262);
  wrongBefore = wrong;
  if (state.live && state.live.readings) drawScene();
  drawNow();
  if (news.buttons || "alert" in news || news.phase) {
    drawButtons((name, k) => name === "retake" && state.alert ? "wrong" : state.phase !== "measuring" && k === 0 ? "main" : "");
  }
  if (news.stations || "map" in news) drawPlaces();
  if (news.determined) drawKnown();
  if ("plan" in news || news.phase) drawPlan();
  if ("verdict" in news || news.phase) drawVerdict();
  if (news.lines) $("log").lastChild.replaceChildren(...[...news.lines].reverse().map(line => element("li", line)));
}
connect(heard);
