"""What the guided page costs while an arm is measured: shares of a core, of each process.

    bench_guide.py [--seconds 20]

An emulated SUTA sends 768 readings a second, one browser shows the page and one the scene. Fails
where the process that reads and draws takes half a core. Time of a processor counts, not of a
clock, so a busy computer does not matter.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import viser
from websockets.sync.client import connect

REPOSITORY = Path(__file__).resolve().parents[1]


def processor_time(process: int) -> float:
    """What it has used, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def processes_of(parent: int) -> dict[str, int]:
    """It, and those that it started, by what they do."""
    listed = ["ps", "-o", "pid=,args=", "--ppid", str(parent)]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    found = {"reads and draws": parent}
    for line in lines:
        number, _, words = line.strip().partition(" ")
        found[next(word for word in words.split() if "suta_calib" in word)] = int(number)
    return found


def shares(job: Path, seconds: float) -> tuple[dict[str, float], float]:
    """By process the share of a core; and how often the scene was drawn, Hz."""
    command = [sys.executable, "-m", "suta_calib", "guide", str(job)]
    command += ["--emulate", "--port", "0", "--no-open"]
    guide = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert guide.stdout is not None
    opened = next(line for line in guide.stdout if line.startswith("Open "))
    url = opened.split()[1].replace("http", "ws")
    threading.Thread(target=guide.stdout.read, daemon=True).start()
    told = {"talk": 0, "scene/": 0}
    measuring = threading.Event()

    def read(path: str, *protocols: str) -> None:
        with connect(url + path, max_size=None, subprotocols=list(protocols) or None) as client:  # type: ignore[arg-type]
            for message in client:
                told[path] += 1
                if path == "talk" and '"resting": false' in str(message):
                    measuring.set()

    for given in (("talk",), ("scene/", f"viser-v{viser.__version__}")):
        threading.Thread(target=read, args=given, daemon=True).start()
    try:
        measuring.wait(240.0)
        begun = {name: (pid, processor_time(pid)) for name, pid in processes_of(guide.pid).items()}
        drawn, start = told["scene/"], time.monotonic()
        time.sleep(seconds)
        lasted = time.monotonic() - start
        used = {name: processor_time(pid) - before for name, (pid, before) in begun.items()}
        return {n: s / lasted for n, s in used.items()}, (told["scene/"] - drawn) / lasted
    finally:
        guide.terminate()
        guide.wait(60.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "calibration.yaml"
        source = REPOSITORY / "data" / "suta"
        text = (source / "calibration.yaml").read_text()
        job.write_text(text.replace("../../urdf/", f"{REPOSITORY}/urdf/"))
        shutil.copy(source / "artefact.yaml", folder)
        found, rate = shares(job, parser.parse_args().seconds)
    for name, share in found.items():
        print(f"{name}: {share:.2f} of a core")
    print(f"the scene was told {rate:.0f} times a second")
    if found["reads and draws"] >= 0.5:
        sys.exit("expected less than half a core")


if __name__ == "__main__":
    main()
