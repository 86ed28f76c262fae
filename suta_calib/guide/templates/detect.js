"use strict";
let countBefore = null;

function drawParts() {
  const parts = state.parts || [], columns = state.columns, rows = parts.length / columns;
  $("parts").setAttribute("viewBox", `0 0 ${columns * 10} ${rows * 10}`);
  $("parts").replaceChildren(...parts.map((count, k) => {
    const part = svgElement("rect", {x: 10 * (k % columns) + 0.4, y: 10 * Math.floor(k / columns) + 0.4, width: 9.2, height: 9.2, rx: 1});
    part.setAttribute("class", count ? "full" : "");
    part.style.opacity = count ? Math.min(0.45 + 0.2 * count, 1) : 1;
    return part;
  }));
}
function drawTilts() {
  const missing = state.missing || [], at = {facing: [0, 0], left: [-30, 0], right: [30, 0], top: [0, -30], bottom: [0, 30]};
  const wanted = Object.entries(at).map(([way, [x, y]]) =>
    svgElement("circle", {cx: x, cy: y, r: 9, class: missing.includes(way) ? "wanted" : "full"}));
  const taken = (state.tilts || []).map(([right, down]) =>
    svgElement("circle", {cx: Math.max(-46, Math.min(46, right)), cy: Math.max(-46, Math.min(46, down)), r: 2.2, class: "taken"}));
  $("tilts").replaceChildren(svgElement("circle", {cx: 0, cy: 0, r: 46, class: "rim"}), ...wanted, ...taken);
}
connect(news => {
  const taking = state.phase === "taking";
  put("title", state.title);
  put("count", state.count === undefined ? "" : `${state.count} ${state.count === 1 ? "picture" : "pictures"}`);
  put("ask", ""); put("how", "");
  $("name").className = "long";
  put("name", taking ? state.advice || "Hold the board in front of the camera" : state.phase === "calibrating" ? "Calibrating" : "");
  put("doing", state.phase === "calibrating" ? "This takes a few seconds to a minute." : taking ? state.doing || "" : "");
  $("now").className = !taking ? "" : state.enough || (state.doing || "").endsWith("taken") ? "taken" : state.seen ? "hold" : "wrong";
  if (news.picture) { $("live").hidden = false; $("live").src = "picture.jpg?" + news.picture; }
  if (news.parts) { drawParts(); drawTilts(); }
  if (countBefore !== null && state.count > countBefore) beep(880);
  if (state.count !== undefined) countBefore = state.count;
  if (news.buttons || "enough" in news) drawButtons(name => name === "finish" && state.enough || name === "end" ? "main" : "");
  if ("verdict" in news || news.phase) drawVerdict();
});
