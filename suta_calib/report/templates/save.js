// Below each figure: buttons that save it, as it is on white paper, as SVG and as PNG.
const saved = (figure) => {
  const rules = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules]);
  // The first rule has the light colours.
  const paper = rules.find((rule) => rule.selectorText === ":root").style;
  const parts = [...figure.querySelectorAll("svg")].filter((svg) => !svg.closest(".key"));
  const boxes = parts.map((svg) => svg.viewBox.baseVal), keys = [...figure.querySelectorAll(".key")];
  const [left, top] = [Math.min(...boxes.map((box) => box.x)), Math.min(...boxes.map((box) => box.y))];
  const right = Math.max(...boxes.map((box) => box.x + box.width)), line = 20;
  const bottom = Math.max(...boxes.map((box) => box.y + box.height));
  const [width, height] = [right - left, bottom - top + line * keys.length];
  const make = (name, attributes, ...inside) => {
    const made = document.createElementNS(parts[0].namespaceURI, name);
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    made.append(...inside);
    return made;
  };
  const all = make("svg", {viewBox: `${left} ${top} ${width} ${height}`, width, height, class: figure.className},
    make("rect", {x: left, y: top, width, height, fill: "#ffffff"}));
  parts.forEach((svg, k) => {
    const part = svg.cloneNode(true), {x, y, width, height} = boxes[k];
    part.removeAttribute("style");
    Object.entries({x, y, width, height}).forEach(([key, value]) => part.setAttribute(key, value));
    all.append(part);
  });
  // What stands below a scene: each look with its name.
  keys.forEach((key, k) => {
    const swatch = key.querySelector("path"), [x, y] = [left + 12, bottom + line * (k + 0.5)];
    if (swatch) all.append(make("g", {class: key.className, transform: `translate(${x} ${y})`}, swatch.cloneNode()));
    all.append(make("text", {x: x + 26, y: y + 4}, key.textContent.trim()));
  });
  if (keys.length) {
    const own = rules.filter((rule) => /^\.scene (\.\w+ )?(path|text)/.test(rule.selectorText || ""));
    const style = own.map((rule) => rule.cssText).join("\n") + "\ntext { font-family: sans-serif; }";
    all.prepend(make("style", {}, style.replace(/vector-effect:[^;]*;/g, "")));
  }
  const text = new XMLSerializer().serializeToString(all);
  return [text.replace(/var\((--\w+)\)/g, (_, name) => paper.getPropertyValue(name).trim()), width, height];
};
const savable = (figure) => {
  const {id: name} = figure.id ? figure : figure.querySelector(".panels, svg[id]") || {id: "figure"};
  const save = (ending, address) => Object.assign(document.createElement("a"), {href: address, download: `${name}.${ending}`}).click();
  const address = (text) => "data:image/svg+xml;charset=utf-8," + encodeURIComponent(text);
  const png = (then) => {
    const [text, width, height] = saved(figure), picture = new Image();
    picture.onload = () => {
      // At least two thousand pixels wide, which a journal can print.
      const times = Math.max(2, 2000 / width), canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [Math.round(times * width), Math.round(times * height)];
      canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
      then(canvas.toDataURL("image/png"));
    };
    picture.src = address(text);
  };
  const ways = {SVG: () => save("svg", address(saved(figure)[0])), PNG: () => png((it) => save("png", it))};
  const row = document.createElement("p");
  row.className = "save";
  Object.entries(ways).forEach(([way, start]) => {
    const button = Object.assign(document.createElement("button"), {type: "button", textContent: way, onclick: start});
    button.setAttribute("aria-label", `Save the figure as ${way}`);
    row.append(button);
  });
  row.prepend("save as ");
  figure.append(row);
};
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("figure").forEach((figure) => figure.querySelector("svg") && savable(figure));
});
