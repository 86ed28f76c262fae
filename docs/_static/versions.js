// Offers the versions that versions.json beside this one's folder names (tools/site_versions.py).
// Without that file, as in a build on one's own disk, nothing is shown.
document.addEventListener("DOMContentLoaded", async () => {
  const here = new URL(document.documentElement.dataset.content_root || "./", location.href);
  const site = new URL("../", here);
  const page = location.href.slice(here.href.length);
  const known = await fetch(new URL("versions.json", site))
    .then((answer) => (answer.ok ? answer.json() : []))
    .catch(() => []);
  const current = known.find((each) => new URL(each.url, site).href === here.href);
  if (!current) return;
  // The same page, where that version has it.
  const open = async (version) => {
    const same = new URL(version.url + page, site);
    const there = await fetch(same, { method: "HEAD" }).catch(() => ({ ok: false }));
    location.assign(there.ok ? same : new URL(version.url, site));
  };
  const label = document.querySelector(".versions");
  const select = label.querySelector("select");
  for (const each of known) {
    select.add(new Option(each.version, each.version, false, each === current));
  }
  select.onchange = () => open(known[select.selectedIndex]);
  label.hidden = false;
  const preferred = known.find((each) => each.preferred);
  if (preferred && preferred !== current) {
    const note = document.createElement("p");
    note.className = "other-version";
    const link = document.createElement("a");
    link.href = new URL(preferred.url, site);
    link.textContent = `the latest release is ${preferred.version}`;
    link.onclick = (event) => (event.preventDefault(), open(preferred));
    note.append(`You read about version ${current.version}; `, link, ".");
    document.querySelector("article").prepend(note);
  }
});
