"""A folder of results: JSON and whatever stands beside it, the files of one run together."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from suta_calib.assessment import attempt
from suta_calib.atomic import exchange_files
from suta_calib.errors import OutputError
from suta_calib.exchange.result import content_digest
from suta_calib.report.document import Document, Figure, File, remark
from suta_calib.report.listing import json_text

REPORT: Final = "report.html"


def write_document(
    answer: Document, folder: Path, inputs: Mapping[str, str] = MappingProxyType({})
) -> dict[str, Any]:
    """Write a document: its JSON, its pictures and files, its section in ``report.html``.

    The files are exchanged together, and those of the run before that this one does not write are
    removed: what stands in the folder is of one run. The JSON says of which.

    Args:
        answer: NAME is its name, and `Document.written` says which of these it has. Figures are
            written as ``NAME.svg``, or ``NAME_1.svg``, ``NAME_2.svg``, … where there are several.
        folder: created if it is not there.
        inputs: files that it was made from, the job first: the SHA-256 of each.

    Returns:
        The answer's JSON, and what its file holds beside: ``files``, the paths written by name,
        and ``run``, its id, its inputs and the SHA-256 of its files and of its own content.

    Raises:
        OutputError: the folder or a file in it cannot be written. Where that can be seen before,
            nothing is written.
    """
    notes = list[str]()
    contents = _contents(answer, notes)
    answer = replace(answer, assessment=answer.assessment.with_care(notes))
    hashes = {name: sha256(data).hexdigest() for name, data in contents.items()}
    run = run_record(answer.name, inputs, hashes)
    record = {"result": "result.json", "files": ""}.get(answer.written, f"{answer.name}.json")
    if answer.written not in ("record", "files"):
        job = Path(next(iter(inputs), "")).name
        from suta_calib.report.page import page_with

        report, page = _report(answer, folder, job)
        made_from = (f" from {Path(n).name} (SHA-256 {h[:12]})" for n, h in inputs.items())
        run_note = remark(f"Run {run['id']}{', '.join(made_from)}.")
        with_run = replace(answer, parts=(*answer.parts, run_note))
        contents[report] = page_with(with_run, page, job).encode(errors="replace")
    names = [*contents, record] if record else [*contents]
    complete = answer.json()
    complete |= {"files": {name: str(folder / name) for name in names}}
    if record:
        complete["run"] = run | {"content": content_digest(json.loads(json_text(complete)))}
        # Of a name that is no Unicode this makes JSON's own escape.
        contents[record] = json_text(complete).encode(errors="backslashreplace")
    for path in (folder / name for name in names):
        if path.is_dir():
            raise OutputError(
                f"{path}: not written: found a folder of this name; expected a file or nothing; "
                "choose another folder with --out"
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be used as the output folder: {error.strerror}; choose another one"
        ) from error
    # A page with sections of others stays, unless it shows the run before.
    current = {*names, *([] if answer.written == "record" else [REPORT])}
    stale = _written_before(folder / record) - current if record else ()
    exchange_files(folder, contents, stale)
    return complete


def run_record(name: str, inputs: Mapping[str, str], hashes: Mapping[str, str]) -> dict[str, Any]:
    """The key ``run`` of an answer of that name: its id follows from the rest."""
    run: dict[str, Any] = {"inputs": dict(inputs), "sha256": dict(hashes)}
    content = json_text({name: run}, ascii_only=True).encode()
    return {"id": sha256(content).hexdigest()[:12], **run}


def results_for(job: Path) -> Path:
    """Where the answer on a job, or on a result (its folder, or a JSON in it), is written."""
    if job.is_dir():
        return job
    return job.parent if job.suffix.lower() == ".json" else results_beside(job)


def results_beside(job: Path) -> Path:
    """Where the answer on a job is written: each job of a folder has its own folder of results."""
    out = job.parent / "results"
    other_jobs = (job.parent / name for name in _jobs_of(out))
    if any(other.is_file() and other.name != job.name for other in other_jobs):
        out = results_of_its_own(job)
    return out


def results_of_its_own(job: Path) -> Path:
    """Where the answer on a job is written if ``results`` beside it is another job's."""
    return job.parent / f"results-{job.stem}"


def _jobs_of(folder: Path) -> Iterator[str]:
    """Names of the jobs whose answers a folder holds."""
    # Answers that a folder of results holds at most, one of each command; and what `run`, the last
    # key of one, takes.
    most_records = 100
    run_bytes = 1 << 16
    records = (path for path in folder.glob("*.json") if path.is_file())
    for path in islice(records, most_records):
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            with path.open("rb") as file:
                file.seek(max(0, path.stat().st_size - run_bytes))
                end = file.read(run_bytes).decode(errors="replace")
            # What follows it is of no interest, and what is before it may be long.
            _, _, text = end.rpartition('"run":')
            run, _ = json.JSONDecoder().raw_decode(text.lstrip())
            yield Path(next(iter(run["inputs"]), "")).name


def _report(answer: Document, folder: Path, job: str) -> tuple[str, str | None]:
    """Name of the page that an answer stands on, and what is there; a page is of one job."""
    from suta_calib.report.page import BEGINS, belongs, holds_others

    path = folder / REPORT
    page = _page(path)
    if answer.written in BEGINS or page is None or belongs(page, job):
        return REPORT, page
    if not holds_others(answer, page):
        return REPORT, None
    path = folder / f"report-{Path(job).stem}.html"
    return path.name, _page(path)


def _page(path: Path) -> str | None:
    """The page that is there, however it was written."""
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else None


def _written_before(record: Path) -> set[str]:
    """Names of files that a run before wrote beside its JSON, as far as nobody changed them."""
    try:
        previous = json.loads(record.read_text(encoding="utf-8"))
        files, hashes = dict(previous["files"]), dict(previous.get("run", {}).get("sha256", {}))
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return set()
    unchanged = set()
    for name in files:
        path = record.parent / name
        if Path(name).name == name and path.is_file():
            data = path.read_bytes() if name in hashes else b""
            if name not in hashes or sha256(data).hexdigest() == hashes[name]:
                unchanged.add(name)
    return unchanged


def _contents(answer: Document, notes: list[str]) -> dict[str, bytes]:
    """Pictures and further files by name, in the document's order; ``notes`` of what failed."""
    figures = [part for part in answer.parts if isinstance(part, Figure)]
    contents: dict[str, bytes] = {}
    for part in answer.parts:
        if isinstance(part, File):
            # A file that is the answer itself is written, or the command fails.
            if answer.written == "files":
                contents[part.name] = part.as_bytes()
            elif (
                content := attempt(f"written: {part.name}", part.as_bytes, None, notes)
            ) is not None:
                contents[part.name] = content
        elif isinstance(part, Figure) and answer.written not in ("opening", "record"):
            number = f"_{figures.index(part) + 1}" if len(figures) > 1 else ""
            contents[f"{answer.name}{number}.svg"] = part.svg.encode()
    return contents
