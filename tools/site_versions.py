"""Put a built site beside those of other versions: ``site_versions.py SITE VERSION BUILT``.

SITE has a folder for each version, `versions.json`, from which every page offers them
(``docs/_static/versions.js``), and an `index.html` that leads to the preferred one: the latest
release, or ``main`` before there is any. The workflow docs.yml keeps SITE in the branch gh-pages.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from packaging.version import InvalidVersion, Version

# Of a build: what no reader opens.
UNREAD = (".doctrees", ".buildinfo")
ROOT = """\
<!doctype html>
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={version}/">
<link rel="canonical" href="{version}/">
<title>suta_calib</title>
<a href="{version}/">suta_calib {version}</a>
"""


def put(site: Path, version: str, built: Path) -> list[dict[str, object]]:
    """Add or replace a version; returns what `versions.json` says then, the newest first."""
    if not (built / "index.html").is_file():
        raise SystemExit(f"{built}: found no index.html; expected a site that make docs has built")
    if order(version) is None:
        raise SystemExit(f"{version}: expected a version, such as 1.2.0, or main")
    shutil.rmtree(site / version, ignore_errors=True)
    shutil.copytree(built, site / version, ignore=shutil.ignore_patterns(*UNREAD))
    there = [path.parent.name for path in site.glob("*/index.html")]
    names = sorted((name for name in there if order(name) is not None), key=order, reverse=True)
    releases = [name for name in names if name != "main" and not Version(name).is_prerelease]
    preferred = next(iter([*releases, *names]))
    found: list[dict[str, object]] = [
        {"version": name, "url": f"{name}/", "preferred": name == preferred} for name in names
    ]
    (site / "versions.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (site / "index.html").write_text(ROOT.format(version=preferred), encoding="utf-8")
    return found


def order(name: str) -> Version | None:
    """Where a version stands among others; None where a folder is none."""
    try:
        return Version("99999" if name == "main" else name)
    except InvalidVersion:
        return None


if __name__ == "__main__":
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    for each in put(Path(sys.argv[1]), sys.argv[2].removeprefix("v"), Path(sys.argv[3])):
        print(each["version"], "(preferred)" if each["preferred"] else "")
