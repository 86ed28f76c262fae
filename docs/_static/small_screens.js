document.addEventListener("DOMContentLoaded", () => {
  // A picture opens in its own size: a telephone shows wide ones small.
  for (const picture of document.querySelectorAll("article img")) {
    if (picture.closest("a")) continue;
    const link = document.createElement("a");
    link.href = picture.src;
    picture.replaceWith(link);
    link.append(picture);
  }
  // Tables of four columns and more with long cells are stacked there (narrow_screens.css).
  for (const table of document.querySelectorAll("article table.docutils")) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    const rows = [...table.querySelectorAll("tbody tr")];
    const letters = rows.reduce((sum, row) => sum + row.textContent.length, 0) / rows.length;
    if (heads.length < 4 || letters < 120) continue;
    table.classList.add("stacked");
    for (const row of rows) {
      [...row.cells].slice(1).forEach((cell, k) => (cell.dataset.label = heads[k + 1]));
    }
  }
});
