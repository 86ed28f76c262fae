"use strict";
// What the pages share: parts of the page, buttons, a tone, and the connection.
const $ = id => document.getElementById(id), state = {};
let socket, audio;

function element(tag, text, kind) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}
function put(id, text) { $(id).textContent = text; $(id).hidden = !text; }
function press(button) { if (socket && socket.readyState === 1) socket.send(JSON.stringify(button)); }
function svgElement(tag, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, text] of Object.entries(attributes)) made.setAttribute(name, text);
  return made;
}
function beep(...tones) {
  if (!$("sound").checked || !audio) return;
  tones.forEach((tone, k) => {
    const source = audio.createOscillator(), volume = audio.createGain(), at = audio.currentTime + 0.16 * k;
    source.frequency.value = tone; volume.gain.setValueAtTime(0.15, at); volume.gain.exponentialRampToValueAtTime(0.001, at + 0.15);
    source.connect(volume).connect(audio.destination); source.start(at); source.stop(at + 0.15);
  });
}
// A browser makes sound only once somebody has touched the page.
addEventListener("pointerdown", () => { audio ??= new AudioContext(); });
addEventListener("keydown", () => { audio ??= new AudioContext(); });

function drawButtons(kindOf) {
  $("buttons").replaceChildren(...(state.buttons || []).map(({do: name, label}, k) => {
    const button = element("button", label, kindOf(name, k));
    button.dataset.do = name;
    button.onclick = () => { press(name); button.blur(); };
    return button;
  }));
}
function drawVerdict() {
  const verdict = state.verdict;
  $("verdict").hidden = !verdict || state.phase !== "done";
  if (!verdict) return;
  $("verdict").className = verdict.level;
  $("verdict").firstChild.textContent = verdict.word;
  put("headline", verdict.headline || ""); put("statement", verdict.text);
  $("notes").replaceChildren(...(verdict.notes || []).map(note => element("li", note)));
  $("files").replaceChildren(...(verdict.files || []).sort((a, b) => (b === "report.html") - (a === "report.html")).map(file => {
    const link = element("a", file === "report.html" ? "Open the report" : file);
    link.href = "files/" + file; link.target = "_blank";
    return link;
  }));
  put("folder", verdict.folder ? "in " + verdict.folder : "");
}
function connect(heard) {
  socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[?#].*$/, "").replace(/\/$/, "") + "/talk");
  socket.onmessage = event => {
    const news = JSON.parse(event.data);
    Object.assign(state, news);
    heard(news);
    if ("browsers" in news) put("browsers", state.browsers > 1 ? `${state.browsers} browsers show this page; each can press the buttons` : " ");
  };
  socket.onclose = () => {
    $("now").className = ""; $("buttons").replaceChildren();
    for (const id of ["ask", "doing", "alert", "rest"]) $(id).hidden = true;
    put("name", "suta-calib has ended"); $("name").className = "long";
    put("how", "What is taken is saved. Start it again to go on: the page then has a new address.");
    setTimeout(() => connect(heard), 2000);
  };
}
