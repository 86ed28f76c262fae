// Projects the points of a scene again while it is dragged; the page holds the first picture.
function turnable(figure, scene) {
  const svg = figure.querySelector("svg"), groups = svg.querySelectorAll("g");
  let [azimuth, elevation] = scene.view, from = null;
  const draw = () => {
    const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
    const at = (point) => {
      const [x, y, z] = point.map((value, k) => scene.scale * (value - scene.middle[k]));
      return [ca * y - sa * x, se * (ca * x + sa * y) - ce * z].map((value) => value.toFixed(1));
    };
    scene.parts.forEach((part, n) => {
      let d = "", drawing = false;
      part.p.forEach((point, k) => {
        if (point) {
          d += (drawing && part.line ? "L" : "M") + at(point).join(" ");
          d += part.q ? "L" + at(part.q[k]).join(" ") : part.line ? "" : "h0";
        }
        drawing = Boolean(point);
      });
      groups[n].querySelector("path").setAttribute("d", d);
      groups[n].querySelectorAll("text").forEach((text, k) => {
        const [x, y] = at(part.p[k]);
        text.setAttribute("x", x);
        text.setAttribute("y", y);
      });
    });
  };
  figure.classList.add("turns");
  svg.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (!from) return;
    azimuth -= (event.clientX - from[0]) / 150;
    elevation = Math.max(-1.55, Math.min(1.55, elevation + (event.clientY - from[1]) / 150));
    from = [event.clientX, event.clientY];
    draw();
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { from = null; });
}
