"""Pages that the package writes about itself: files, kinds of observation, commands, names.

Each is made anew by every build into ``docs/generated``; nothing there is kept. What a reader of a
file checks (`suta_calib.measurements.keys`) is what the tables show, so that they cannot go stale.
"""

from __future__ import annotations

import inspect
import json
import os
import pkgutil
import re
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import click

import suta_calib
from suta_calib.analysis.planning.candidates import KEYS as CANDIDATE_KEYS
from suta_calib.certification import read_raw_points
from suta_calib.cli._app import COMMANDS, PROGRAM, app
from suta_calib.device.device_file import DEVICE_KEYS
from suta_calib.job import CalibrationJob
from suta_calib.job.acceptance import ACCEPTANCE_KEYS
from suta_calib.job.keys import JOB_KEYS
from suta_calib.measurements import pose_files, read_corners
from suta_calib.measurements.artefact import ARTEFACT_KEYS
from suta_calib.measurements.board import CHARUCO_KEYS, CHESSBOARD_KEYS, MARKERS_KEYS
from suta_calib.measurements.camera import CAMERA_KEYS
from suta_calib.measurements.csv_table import length_columns, position_columns, rotation_columns
from suta_calib.measurements.keys import Keys
from suta_calib.report.calibration import calibration_document
from suta_calib.simulation.keys import SIMULATION_KEYS, set_keys
from suta_calib.terms import KINDS, Term

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
# Characters in a line of help, so that a telephone shows most of it.
HELP_WIDTH = 88


@dataclass(frozen=True)
class FileFormat:
    """One YAML file that the package reads.

    Attributes:
        name: of the file.
        about: what it is for.
        keys: by title, its keys; one title only where there is one sort of it.
        example: a shipped file, from the repository's root, or a text.
    """

    name: str
    about: str
    keys: dict[str, Keys]
    example: str


DEVICE_EXAMPLE = """\
port: /dev/ttyACM0
baudrate: 921600
format: frames
joints: [{name: joint_1, sign: 1}, {name: joint_2, sign: -1}]
"""
CANDIDATES_EXAMPLE = """\
repeats: 3
grids:
  G: {x_mm: [450, 500], y_mm: [-50, 50], z_mm: 0, yaw_deg: [0, 90]}
points:
  F1: {position_mm: [460, 10, 150], directions: 20, cone_deg: 60}
"""
FILES = (
    FileFormat(
        "calibration.yaml",
        "One calibration: the arm, what is unknown of it, what was observed, what is held out. "
        "Paths are relative to the file.",
        {"": JOB_KEYS},
        "data/suta/calibration_full.yaml",
    ),
    FileFormat(
        "artefact.yaml",
        "A rigid body with landmarks whose places in it are certified.",
        {"": ARTEFACT_KEYS},
        "examples/panda_sockets/artefact.yaml",
    ),
    FileFormat(
        "board.yaml",
        "A board that a camera sees.",
        {
            "type: chessboard": CHESSBOARD_KEYS,
            "type: charuco": CHARUCO_KEYS,
            "type: markers": MARKERS_KEYS,
        },
        "data/workcell/board.yaml",
    ),
    FileFormat(
        "camera.yaml",
        "A calibrated camera, as ROS and OpenCV write it. Other keys are ignored.",
        {"": CAMERA_KEYS},
        "examples/camera_on_arm/camera.yaml",
    ),
    FileFormat(
        "device.yaml",
        "An arm on a cable: which port, which format, which joints.",
        {"": DEVICE_KEYS},
        DEVICE_EXAMPLE,
    ),
    FileFormat(
        "simulation.yaml",
        "Measurements to simulate: the nominal arm, how the true one departs from it, what "
        "scatters, and what is measured.",
        {"": SIMULATION_KEYS}
        | {f"a set of kind {name}": set_keys(kind) for name, kind in KINDS.items()},
        "data/plane/simulation.yaml",
    ),
    FileFormat(
        "iso10360.yaml",
        "An acceptance test after ISO 10360-12. A calibration.yaml may be given in its place, "
        "without limits.",
        {"": ACCEPTANCE_KEYS},
        "data/accuracy/iso10360.yaml",
    ),
    FileFormat(
        "candidates.yaml",
        "What could be measured next, for `suta-calib plan --candidates`.",
        {"": CANDIDATE_KEYS},
        CANDIDATES_EXAMPLE,
    ),
)


def pages() -> dict[str, str]:
    """Every generated page: its name below ``docs/generated``, and its Markdown."""
    found = {
        "design.md": shown_file("ARCHITECTURE.md"),
        "changelog.md": shown_file("CHANGELOG.md"),
        "contributing.md": shown_file("CONTRIBUTING.md"),
        "examples.md": shown_file("examples/README.md") + examples_listed(),
        "csv.md": "".join(csv_page()),
        "result.md": "".join(result_page()),
        "files.md": "".join(files_page()),
        "observations.md": "".join(observations_page()),
        "commands.md": "".join(commands_page()),
        "api.md": "".join(api_index()),
    }
    found |= {f"examples/{name}.md": shown_file(f"examples/{name}/README.md") for name in EXAMPLES}
    return found | {f"api/{name}.md": text for name, text in api_pages()}


def write(folder: Path) -> None:
    """Write the generated pages, and copies of the notebooks beside them."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in pages().items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    (folder / "notebooks").mkdir()
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        (folder / "notebooks" / notebook.name).write_text(shown_notebook(notebook), "utf-8")


# ── what stands elsewhere in the repository ──────────────────────────────────────────────────
# Where such a file is a page here.
PAGES = {
    "ARCHITECTURE.md": "generated/design.md",
    "CHANGELOG.md": "generated/changelog.md",
    "CONTRIBUTING.md": "generated/contributing.md",
    "examples": "generated/examples.md",
    "examples/README.md": "generated/examples.md",
}
EXAMPLES = sorted(path.parent.name for path in ROOT.glob("examples/*/README.md"))
PAGES |= {f"examples/{name}": f"generated/examples/{name}.md" for name in EXAMPLES}
_LINK = re.compile(r"(?<!!)\[([^\]\n]*)\]\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)")


def examples_listed() -> str:
    """The examples' pages below their table."""
    listed = "\n".join(f"examples/{name}" for name in EXAMPLES)
    return f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def relinked(text: str, source: Path, target: Path) -> str:
    """Markdown of the repository as a page of the site: links to no page become names of files.

    Args:
        text: the Markdown.
        source: folder that its links are relative to, from the repository's root.
        target: folder of the page, from the same root.
    """

    def link(found: re.Match[str]) -> str:
        shown, to, section = found[1], found[2], found[3] or ""
        name = os.path.normpath(source / to)
        if name in PAGES or name.startswith("docs/"):
            page = f"docs/{PAGES[name]}" if name in PAGES else name
            return f"[{shown}]({os.path.relpath(page, target)}{section})"
        if name.startswith("notebooks/") and name.endswith(".ipynb"):
            page = f"docs/generated/{name}"
            return f"[{shown}]({os.path.relpath(page, target)}{section})"
        plain = shown.strip("`")
        return f"`{name}`" if plain in (name, to, Path(name).name) else f"{shown} (`{name}`)"

    return _LINK.sub(link, text)


def shown_notebook(path: Path) -> str:
    """A notebook as it is stored, its links for the site."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    for each in notebook["cells"]:
        if each["cell_type"] == "markdown":
            text = "".join(each["source"])
            each["source"] = relinked(text, Path("notebooks"), Path("docs/generated/notebooks"))
    return json.dumps(notebook, ensure_ascii=False)


def shown_file(name: str) -> str:
    """A Markdown file of the repository as a page: an example's among those of examples."""
    text = (ROOT / name).read_text(encoding="utf-8")
    folder = Path(name).parent
    below = "examples" if folder.name in EXAMPLES else ""
    return relinked(text, folder, Path("docs/generated", below))


# ── files ────────────────────────────────────────────────────────────────────────────────────
def files_page() -> Iterator[str]:
    """Every YAML file: its keys, and an example."""
    yield "# YAML files\n\n"
    yield (
        "Made from what the readers check. A key that is not listed is refused, with the line it "
        "stands in; **bold** keys must be there. Lengths are in mm and angles in degrees, and the "
        "key says so.\n\n"
    )
    for file in FILES:
        yield f"({anchor(file.name)})=\n## {file.name}\n\n{file.about}\n\n"
        shown: set[int] = set()
        for title, keys in file.keys.items():
            if title:
                yield f"### `{title}`\n\n"
            yield from key_tables(keys, shown)
        yield f"Example:\n\n```yaml\n{example(file.example)}```\n\n"


def example(text: str) -> str:
    """A shipped file's content, or the text itself."""
    return text if "\n" in text else (ROOT / text).read_text(encoding="utf-8")


def key_tables(keys: Keys, shown: set[int], path: str = "") -> Iterator[str]:
    """A table of these keys, then one for each mapping below them that is not shown yet.

    Args:
        keys: of one mapping.
        shown: identities of the mappings that have been shown; added to.
        path: where these stand; empty for the whole file.
    """
    rows = [
        (f"**`{key.name}`**" if key.required else f"`{key.name}`", key.takes, key.about)
        for key in keys
    ]
    yield table(("key", "value", ""), rows)
    below = [(f"{path}.{key.name}".lstrip("."), key.inside) for key in keys if key.inside]
    first = {id(inside): inside for _, inside in below if id(inside) not in shown}
    shown.update(first)
    for inside in first.values():
        names = [name for name, each in below if each is inside]
        yield f"Under {', '.join(f'`{name}`' for name in names)}:\n\n"
        yield from key_tables(inside, shown, names[0])


# ── kinds of observation ─────────────────────────────────────────────────────────────────────
def observations_page() -> Iterator[str]:
    """What each kind of observation says of itself, and its samples' columns."""
    yield "# Kinds of observation\n\n"
    yield (
        "Each kind says of itself what follows: what was measured, which columns its samples have "
        "beside one per joint (rad; m for prismatic joints), which keys of a job's row are its "
        "own, what it cannot tell by itself, and what it tells that others leave open.\n\n"
    )
    for name, kind in KINDS.items():
        yield f"({anchor(name)})=\n## {name}\n\n{sentence(kind.about)}\n\n"
        yield f"{first_paragraph(kind)} More: {{py:class}}`~suta_calib.terms.{kind.__name__}`.\n\n"
        rows = list(column_rows(kind))
        yield table(("column", ""), rows)
        if kind.needs_artefact:
            yield "Needs an [`artefact.yaml`](files.md#artefact-yaml).\n\n"
        if kind.keys:
            yield "Keys of its own:\n\n"
            yield from key_tables(Keys(*kind.keys), set())
        if kind.leaves_open:
            yield "What it leaves open:\n\n"
            for gap, (why, remedy) in kind.leaves_open.items():
                yield f"* the {gap}: {why}. To know more: {remedy}.\n"
            yield "\n"
        if kind.tells:
            told = "; ".join(f"the {gap} ({advice})" for gap, advice in kind.tells.items())
            yield f"Tells what others may leave open: {told}.\n\n"


def column_rows(kind: type[Term]) -> Iterator[tuple[str, str]]:
    """The columns of a kind's samples beside the joints', and what they hold."""
    columns = kind.columns
    optional = {*columns.common_labels, *columns.common_lengths, *columns.optional_labels}
    position, rotation = ", ".join("xyz"), ", ".join(rotation_columns())
    if columns.orientation == "optional":
        optional.add(rotation)
    shown = {name: f"`{name}`" for name in columns.labels}
    if columns.position:
        shown[position] = f"`{position}` in m, or `{', '.join(position_columns()[3:])}`"
    if columns.orientation != "none":
        shown[rotation] = f"`{rotation}`"
    for name in columns.common_lengths:
        shown[name] = " in m, or ".join(f"`{each}`" for each in length_columns(name))
    shown |= {n: f"`{n}`" for n in (*columns.common_labels, *columns.optional_labels)}
    for name, text in shown.items():
        about = columns.about.get(name, "")
        yield text, f"{about} May be left out." if name in optional else about


# ── other files ──────────────────────────────────────────────────────────────────────────────
# CSV files that are no samples: by name, what they are, what reads them, a shipped one.
CSV_FILES = {
    "POSES.csv": (
        "Poses of a tracked tool, `T_tracker_tool`; with `point`, of several posts.",
        pose_files.read_tool_poses,
        "examples/pivot_tool/poses.csv",
    ),
    "PAIRS.csv": (
        "`T_base_hand` and `T_eye_target`, row for row taken at the same time.",
        pose_files.read_pose_pairs,
        "data/poses/hand_eye.csv",
    ),
    "HANDS.csv": (
        "`T_base_hand` with the picture that was taken there.",
        pose_files.read_hand_poses,
        "data/workcell/poses.csv",
    ),
    "POINTS.csv": (
        "Points in one frame.",
        pose_files.read_points,
        "data/poses/register_a.csv",
    ),
    "corners.csv": (
        "Where the corners of a board are in pictures.",
        read_corners,
        "data/workcell/corners.csv",
    ),
    "TOUCHES.csv": (
        "Raw points of a laser tracker on an artefact, for `suta-calib certify`.",
        read_raw_points,
        "data/artefact/points.csv",
    ),
}


def csv_page() -> Iterator[str]:
    """Every CSV file: samples by kind, and the others by what their readers say."""
    yield "# CSV files\n\n"
    yield (
        "A header row, commas, one row a measurement. The order of columns is free and columns "
        "that nobody asks for are ignored. Lengths are in m, or in mm where the column is named "
        "so (`x_mm`); quaternions are `qx, qy, qz, qw`.\n\n"
        "## Samples of an arm\n\n"
        "One column per joint of the chain, named as in the URDF, in rad (m for prismatic "
        "joints), as the encoder reports it; a joint that mimics another has none. "
        "`JOINT.direction` may say from which side a joint came (1 or -1). Beside them what the "
        "kind needs:\n\n"
    )
    rows = (
        (f"[`{name}`](observations.md#{anchor(name)})", "; ".join(a for a, _ in column_rows(kind)))
        for name, kind in KINDS.items()
    )
    yield table(("kind", "columns"), rows)
    for name, (about, reader, shipped) in CSV_FILES.items():
        first = (ROOT / shipped).read_text(encoding="utf-8").splitlines()[:3]
        yield f"## {name}\n\n{about} {first_paragraph(reader)}\n\n"
        yield "```text\n" + "\n".join(first) + "\n```\n\n"


RESULT_JOB = ROOT / "examples" / "so101_printed_sheet" / "calibration.yaml"


def result_page() -> Iterator[str]:
    """The keys of ``result.json``, as a shipped job's answer has them."""
    answer = calibration_document(CalibrationJob.load(RESULT_JOB).run()).json()
    yield "# result.json\n\n"
    yield (
        "What `suta-calib calibrate` writes, and prints with `--json`: here as "
        f"`{RESULT_JOB.relative_to(ROOT)}` gives it, with the first rows of each list. Values that "
        "are parameters are in SI and say their `unit`; others say it in their key. Beside it are "
        "`calibrated.urdf`, `residuals.csv` (one row per residual) and `report.html`. `run` is "
        "added when the files are written: the SHA-256 of each input, and of each file that "
        "belongs to the run.\n\n"
    )
    if lacking := answer.keys() ^ RESULT_KEYS.keys():
        raise LookupError(f"{', '.join(sorted(lacking))} of result.json: say them in RESULT_KEYS")
    for key, about in RESULT_KEYS.items():
        yield f"## {key}\n\n{about}\n\n```json\n{json_example(answer[key])}\n```\n\n"


RESULT_KEYS = {
    "status": "`converged`, or what the solver ended with.",
    "job": "The job's file.",
    "parameters": "Every parameter by its name: nominal, value, standard deviation, unit, "
    "[state](../guides/messages.md#the-state-of-a-parameter).",
    "external_poses": "What stands outside the arm: as a 4x4 matrix in m, and as position, roll "
    "pitch yaw and quaternion with standard deviations.",
    "unidentified": "Parameters that the data cannot tell.",
    "redundant": "Those of them that no data of these kinds could tell: conventions.",
    "unobservable": "Combinations of parameters that the data leave open.",
    "excluded": "What the job leaves out by name.",
    "metrics": "Errors before and after, on fitted and on held-out data; every residual counts, "
    "also one that a robust fit believes less. `by_term` has them for each row of the job.",
    "repeatability": "How the tip scatters about the mean of repeats of the same touch.",
    "timing_s": "Seconds.",
    "correlations": "Of the estimated parameters, in their order.",
    "covariance": "The same, in SI: what `track` and `tip-map` propagate.",
    "noise": "Noise levels: assumed or given, and found.",
    "priors": "How wide the job's priors were found to be, by group.",
    "solver": "How it was solved, start by start.",
    "versions": "Of what it was solved with.",
    "held_out": "Held-out errors of one component against what was predicted for them.",
    "verdict": "How far it may be trusted: "
    "[what does this message mean?](../guides/messages.md#the-verdict)",
}


# Numbers in a row of an example, and rows, that are shown: a 4x4 matrix is.
SHOWN_NUMBERS = 4


def shortened(value: Any) -> Any:
    """JSON with the first rows of each list, and the first of each mapping by name."""
    if isinstance(value, list):
        rows = any(isinstance(each, dict) for each in value)
        return [shortened(each) for each in value[: 1 if rows else SHOWN_NUMBERS]]
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if not isinstance(value, dict):
        return value
    rows = [each for each in value.values() if isinstance(each, dict)]
    alike = len(rows) > 2 and all(row.keys() & rows[0].keys() for row in rows)
    kept = list(value.items())[:1] if alike else value.items()
    return {name: shortened(each) for name, each in kept}


def json_example(value: Any) -> str:
    """Indented JSON with lists of numbers or names on a line each."""
    text = json.dumps(shortened(value), indent=1, ensure_ascii=False)
    return re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)


# ── commands and names ───────────────────────────────────────────────────────────────────────
def commands_page() -> Iterator[str]:
    """What ``--help`` says of every command, at the width of a text."""
    yield "# Commands\n\n"
    yield (
        "What `--help` says of each. Every command exits with 0 if done, 1 if it ran but the "
        "answer must not be used, 2 for bad usage or bad input.\n\n"
    )
    group = click.Context(app, info_name=PROGRAM, terminal_width=HELP_WIDTH)
    yield table(("command", ""), ((f"[{n}](#{n})", about) for n, about in COMMANDS.items()))
    for name in COMMANDS:
        command = app.get_command(group, name)
        assert command is not None
        context = click.Context(
            command,
            *(group, name),
            terminal_width=HELP_WIDTH,
            help_option_names=["-h", "--help"],
            show_default=True,
        )
        yield f"## {name}\n\n```text\n{command.get_help(context)}\n```\n\n"


# Modules below the root that users meet; the others are small tools.
MODULES = ("suta_calib.assessment", "suta_calib.errors", "suta_calib.units")


def public_packages() -> list[str]:
    """Packages with public names, as `import` has them; the command line is no library."""
    names = [
        module.name
        for parent in ("suta_calib", "suta_calib.analysis")
        for module in pkgutil.iter_modules(import_module(parent).__path__, f"{parent}.")
        if module.ispkg and module.name != "suta_calib.cli"
    ]
    return sorted(name for name in names if getattr(import_module(name), "__all__", ()))


def documented() -> dict[str, list[str]]:
    """Public names by the module that their page describes, each once: where it is at home."""
    packages = public_packages()
    offered = {each: [*import_module(each).__all__] for each in ("suta_calib", *packages)}

    def home(module: str, name: str) -> str:
        defined = getattr(getattr(import_module(module), name), "__module__", None)
        if defined is None:  # a constant
            return next((each for each in packages if name in offered[each]), module)
        at_home = [
            each
            for each in (*packages, *MODULES)
            if f"{defined}.".startswith(f"{each}.") and name in offered.get(each, (name,))
        ]
        return max(at_home, key=len, default=module)

    found = {
        module: [name for name in names if home(module, name) == module]
        for module, names in offered.items()
    }
    for module in MODULES:
        names = vars(import_module(module)).items()
        own = [name for name, each in names if getattr(each, "__module__", "") == module]
        found[module] = [name for name in own if not name.startswith("_")]
    return {module: names for module, names in found.items() if names}


def import_names() -> None:
    """Put every public name into its package: autodoc does not ask for those that come late."""
    for module, names in documented().items():
        found = import_module(module)
        for name in names:
            setattr(found, name, getattr(found, name))


def api_index() -> Iterator[str]:
    """Every public name, by the package where it is described."""
    yield "# Python\n\nEverything documented here is public. Inside, all quantities are SI.\n\n"
    yield f"```python\n{first_code(suta_calib)}```\n\n"
    rows = (
        (f"[{module}](api/{module}.md)", ", ".join(f"`{name}`" for name in names))
        for module, names in documented().items()
    )
    yield table(("module", "names"), rows)
    at_root = ", ".join(f"`{name}`" for name in suta_calib.__all__)
    yield f"From `suta_calib` itself can be imported: {at_root}.\n\n"
    listed = "\n".join(f"api/{module}" for module in documented())
    yield f"```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def api_pages() -> Iterator[tuple[str, str]]:
    """One page of documented names for every public module."""
    for module, names in documented().items():
        directive = f".. automodule:: {module}\n   :members: {', '.join(names)}\n"
        yield module, f"# {module}\n\n```{{eval-rst}}\n{directive}```\n"


# ── Markdown ─────────────────────────────────────────────────────────────────────────────────
def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    heads = tuple(heads)
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join(f"| {' | '.join(map(cell, line))} |\n" for line in lines) + "\n"


def cell(text: str) -> str:
    """Text inside a table."""
    return text.replace("|", "\\|").replace("\n", " ")


def anchor(name: str) -> str:
    """The target of a heading."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower())


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def first_paragraph(thing: object) -> str:
    """The first paragraph of a docstring."""
    return " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())


def first_code(thing: object) -> str:
    """The first indented block of a docstring."""
    (block,) = re.findall(r"::\n\n((?:    .*\n)+)", inspect.getdoc(thing) or "")[:1]
    return inspect.cleandoc(block) + "\n"
