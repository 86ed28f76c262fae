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
  const rows = state.stations || [], live = state.live || {}, plan = state.plan || {};
  const next = (rows.find(row => row[1] === "next") || [""])[0];
  const alert = state.phase === "measuring" && state.alert, silent = live.silence > 1;
  const just = Date.now() - takenAt < 1800;
  put("title", state.title + (state.label ? " · " + state.label : ""));
  put("count", rows.length ? `${rows.filter(row => row[1] === "taken").length} of ${rows.length}` : "");
  // What is asked for, the thing to do or go to in the largest letters, how, what happens, and the kind of box.
  let ask = "", name = "", how = "", doing = "", kind = "";
  if (state.phase === "lost") [ask, name, how, kind] = ["The device is not there", "Check the cable", state.headline, "wrong"];
  else if (state.phase === "calibrating") [name, doing] = [state.headline, "This takes a few seconds to a minute."];
  else if (state.phase === "between") {
    [ask, name, how] = [state.headline, plan.waiting ? "Looking for the best place to measure next …" : plan.head, plan.why];
  } else if (state.phase === "measuring" && silent) {
    [ask, name, kind] = [`No readings for ${live.silence.toFixed(0)} s`, "Check the cable", "wrong"];
    how = "Nothing is lost. It goes on by itself when readings come again.";
  } else if (state.phase === "measuring") {
    [ask, name, how] = alert ? ["Seat again", alert.name, ""] : [state.ask, next, state.how];
    if (!live.readings) doing = "Waiting for readings";
    else if (just && !alert) [doing, kind] = [`${takenName} is measured ✓`, "taken"];
    else if (!live.resting) doing = "Moving";
    else if (live.share < 1) [doing, kind] = ["Hold still", "hold"];
    else doing = alert ? `Or go on to ${next}` : `Go to ${next}`;
    if (alert) kind = "wrong";
  }
  put("ask", ask); put("name", (name || "").replaceAll(" = ", "\u00a0=\u00a0").replaceAll(" mm", "\u00a0mm")); put("how", how); put("doing", doing);
  $("name").classList.toggle("long", (name || "").length > 4);
  $("name").classList.toggle("longer", (name || "").length > 24);
  $("now").className = kind;
  $("rest").hidden = state.phase !== "measuring" || silent;
  // Before something was measured, or where it is measured again, a rest is none: it fills no bar.
  const share = live.share < 1 || takenAt ? live.share || 0 : 0, bar = $("rest").firstChild;
  bar.style.width = 100 * share + "%"; bar.className = share >= 1 ? "full" : "";
  $("alert").hidden = !alert || silent;
  if (alert) { $("alert").firstChild.textContent = alert.title; $("alert").lastChild.textContent = alert.text; }
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
  map.replaceChildren(...marks.map(([name, x, y]) => {
    const group = svgElement("g", {class: kinds[name] || ""});
    const label = svgElement("text", {x, y: -y - 5 * unit, "font-size": 7 * unit});
    label.textContent = name;
    group.append(svgElement("circle", {cx: x, cy: -y, r: 3 * unit}), label);
    return group;
  }));
}
function drawKnown() {
  const known = state.determined;
  put("settled", known.state);
  put("tip", known.tip ? `Tip ${known.tip}` : "");
  put("worst", known.tip ? `worst: ${known.worst}; from ${known.samples} samples` : "");
  $("parameters").replaceChildren(...(known.parameters || []).flatMap(({name, text, share}) => {
    const bar = element("div", undefined, "bar"), fill = element("i");
    fill.style.width = 100 * share + "%"; if (share >= 1) fill.className = "full";
    bar.append(fill); bar.setAttribute("role", "meter"); bar.setAttribute("aria-valuenow", share); bar.setAttribute("aria-label", name);
    return [element("span", name), bar, element("span", text)];
  }));
}
const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => { if (framed) { framed = false; drawScene(); } });
function drawScene() {
  if (framed) return;
  framed = true;
  if (!document.createElement("canvas").getContext("webgl2")) {
    $("scene").replaceChildren(element("p", "This browser shows no 3-D (WebGL 2 is off). The measurement needs none."));
    return;
  }
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
    if (takenBefore && taken.length < takenBefore.length) takenAt = 0;
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
  if ("verdict" in news || news.phase) drawVerdict();
  if (news.lines) $("log").lastChild.replaceChildren(...[...news.lines].reverse().map(line => element("li", line)));
}
connect(heard);
