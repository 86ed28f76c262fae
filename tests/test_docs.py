"""The site: what it says of files, kinds, commands and messages is what the package has."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from shown_blocks import PAGES

import suta_calib
from suta_calib import ArmModel
from suta_calib.analysis.planning import read_candidates
from suta_calib.cli._app import COMMANDS
from suta_calib.device import read_device
from suta_calib.measurements.fields import Field, Fields, fields_of
from suta_calib.registry import shipped
from suta_calib.terms import KINDS

PACKAGE = Path(__file__).resolve().parent.parent / "suta_calib"
# Where keys are declared.
MODULES = [
    ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
    for file in sorted(PACKAGE.rglob("*.py"))
    if "measurements.fields import" in file.read_text(encoding="utf-8")
]
# A screen of text.
README_LINES = 80


Maker = Callable[[str], ModuleType]


@pytest.fixture(scope="module")
def maker(repository: Path) -> Iterator[Maker]:
    """What makes the pages: its modules by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(repository / "docs" / "_ext"))
        yield importlib.import_module


@pytest.fixture(scope="module")
def pages(maker: Maker) -> dict[str, str]:
    found: dict[str, str] = maker("generated").pages()
    return found


def calls_of(method: str, file: Path) -> int:
    """How often a file calls a method of this name."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    calls = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
    return sum(isinstance(called, ast.Attribute) and called.attr == method for called in calls)


def test_whoever_checks_keys_says_what_they_hold() -> None:
    """Readers ask `Fields.check`, so that no key is known that the reference does not show."""
    callers = [file for file in PACKAGE.rglob("*.py") if calls_of("check_keys", file)]
    assert [file.name for file in callers] == ["fields.py"]


def below(keys: Fields) -> Iterator[Field]:
    for key in keys:
        yield key
        if key.value.inside is not None:
            yield from below(key.value.inside)


def test_every_key_that_is_declared_is_shown(maker: Maker, pages: dict[str, str]) -> None:
    declared = {
        (module, key)
        for module in MODULES
        for value in vars(importlib.import_module(module)).values()
        for keys in [fields_of(value) if dataclasses.is_dataclass(value) else value]
        if isinstance(keys, Fields)
        for key in below(keys)
    }
    assert len(declared) > 100
    lacking = [
        f"{module}: {key.name}"
        for module, key in declared
        if maker("markdown_pieces").cell(key.about) not in pages["files.md"]
    ]
    assert lacking == []


def test_every_key_says_something(maker: Maker) -> None:
    for file in maker("yaml_pages").FILES:
        for keys in file.keys.values():
            assert len(set(keys.names)) == len(keys.names)
            for key in below(keys):
                assert key.value.takes, key.name
                assert re.match(r"[A-Z0-9].*\.$|[a-z_0-9: ,(/)-]+.*\.$", key.about), key.name


def test_every_column_of_a_sample_is_described(maker: Maker) -> None:
    for kind in shipped(KINDS).values():
        for column, about in maker("observation_pages").column_rows(kind):
            assert about.strip().removesuffix("May be left out."), f"{kind.kind}: {column}"


def test_every_kind_and_command_has_its_place(pages: dict[str, str]) -> None:
    for kind in shipped(KINDS):
        assert f"\n## {kind}\n" in pages["observations.md"]
        assert f"[`{kind}`]" in pages["csv.md"]
    for command in COMMANDS:
        assert f"\n## {command}\n\n```text\nUsage: suta-calib {command}" in pages["commands.md"]


def test_every_foreign_format_has_its_place(maker: Maker, pages: dict[str, str]) -> None:
    for command, known in maker("format_pages").formats().items():
        assert known
        for name, each in known.items():
            assert f"\n({command}-{name})=\n### {name}\n" in pages["formats.md"]
            assert all(f"| `{option.switch}` |" in pages["formats.md"] for option in each.options)


def test_every_public_name_is_described(maker: Maker, pages: dict[str, str]) -> None:
    described = {name for names in maker("name_pages").documented().values() for name in names}
    assert set(suta_calib.__all__) <= described
    for module, names in maker("name_pages").documented().items():
        assert names, module
        assert f":members: {', '.join(names)}\n" in pages[f"api/{module}.md"]


def test_every_kind_is_compared(repository: Path) -> None:
    guides = repository / "docs" / "guides"
    for page in ("which_observation.md", "which_observation_table.md"):
        rows = re.findall(r"^\| `(\w+)` \|", (guides / page).read_text(encoding="utf-8"), re.M)
        assert rows == list(shipped(KINDS))


@pytest.mark.parametrize("kind", ["fixed_point", "tracked_point"])
def test_what_a_kind_tells_is_computed(
    kind: str, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(repository / "docs" / "figures"))
    table = repository / "docs" / "guides" / "which_observation_table.md"
    row: str = importlib.import_module("which_observation").row(kind)
    assert row in table.read_text(encoding="utf-8")


def test_examples_that_are_no_files_are_read(
    maker: Maker, tmp_path: Path, repository: Path
) -> None:
    for name, text in (
        ("device.yaml", maker("yaml_pages").DEVICE_EXAMPLE),
        ("candidates.yaml", maker("yaml_pages").CANDIDATES_EXAMPLE),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_device(tmp_path / "device.yaml").names == ("joint_1", "joint_2")
    arm = ArmModel.from_urdf(repository / "urdf" / "suta.urdf", "tip")
    assert len(read_candidates(tmp_path / "candidates.yaml", arm).places) == 9


def links(text: str) -> Iterator[str]:
    """Relative links and pictures of a page."""
    shown = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    for to in re.findall(r"\]\(([^)\s]+)\)", shown):
        if not re.match(r"[a-z]+:|#", to):
            yield to.partition("#")[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    there = {to: (page.parent / to).resolve() for to in links(page.read_text(encoding="utf-8"))}
    assert [to for to, path in there.items() if not path.exists()] == []


def test_the_sites_links_lead_to_pages(
    maker: Maker, repository: Path, pages: dict[str, str]
) -> None:
    docs = repository / "docs"
    made = {docs / "generated" / name for name in pages}
    made |= {
        docs / "generated" / "notebooks" / notebook.name
        for notebook in (repository / "notebooks").glob("*.ipynb")
    }
    relinked = maker("repository_pages").relinked
    shown = {docs / "generated" / name: text for name, text in pages.items()}
    for page in docs.rglob("*.md"):
        if "generated" not in page.parts:
            folder = page.parent.relative_to(repository)
            shown[page] = relinked(page.read_text(encoding="utf-8"), folder, folder)
    for page, text in shown.items():
        for to in links(text):
            path = (page.parent / to).resolve()
            assert path in made or (path.exists() and docs in path.parents), f"{page}: {to}"


def test_messages_that_are_explained_are_the_packages_own(repository: Path) -> None:
    source = "".join(file.read_text(encoding="utf-8") for file in sorted(PACKAGE.rglob("*.py")))
    # A sentence is written over several lines.
    source = re.sub(r'"\s*\n\s*f?"', "", source)
    text = (repository / "docs" / "guides" / "messages.md").read_text(encoding="utf-8")
    said = re.findall(r"^\| \*([^|]+)\* \|", text, re.M)
    assert len(said) > 10
    for sentence in said:
        parts = re.split(r"\s*(?:…|\(…\)|\b[NM]\b|\bjoint_\d\b)\s*", sentence)
        known = [part.strip(" .:;()") for part in parts if len(part) > 8]
        assert known, sentence
        assert [part for part in known if part not in source] == []


def test_the_words_below_a_report_are_those_of_the_glossary(repository: Path) -> None:
    page = (repository / "docs/guides/glossary.md").read_text(encoding="utf-8")
    below = (repository / "suta_calib/report/templates/words.html").read_text(encoding="utf-8")
    plain = " ".join(re.sub(r"[*`]", "", page).split())
    rows = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", below)
    assert len(rows) > 10
    for term, meaning in rows:
        assert f"{term} : {re.sub(r'<[^>]+>', '', meaning)}" in plain


def test_the_readme_is_a_screen(repository: Path) -> None:
    lines = (repository / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= README_LINES
    assert sum(line.startswith("![") for line in lines) == 1


def test_the_python_page_has_every_name_of_the_package(repository: Path) -> None:
    text = (repository / "docs" / "guides" / "python.md").read_text(encoding="utf-8")
    code = "".join(re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S))
    # Each is imported there, and used: the page is executed by `test_shown_blocks`.
    used = [name for name in suta_calib.__all__ if len(re.findall(rf"\b{name}\b", code)) < 2]
    assert used == []


def test_every_statistical_test_is_on_its_page(repository: Path) -> None:
    page = (repository / "docs" / "guides" / "decides.md").read_text(encoding="utf-8")
    tails = re.compile(r"from scipy\.special import [^\n]*\b(fdtr|chdtr|stdtr|ndtri)")
    package = repository / "suta_calib"
    deciding = [
        file.relative_to(package).as_posix()
        for file in sorted(package.rglob("*.py"))
        if tails.search(file.read_text(encoding="utf-8"))
    ]
    assert len(deciding) > 20
    assert not [name for name in deciding if f"`{name}`" not in page]
    named = re.findall(r"`([a-z_0-9/]+\.py)`", page)
    assert not [name for name in named if not (package / name).is_file()]


def test_every_version_of_the_site_is_offered(repository: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(repository / "tools"))
        put = importlib.import_module("site_versions").put
    built, site = tmp_path / "built", tmp_path / "site"
    (built / ".doctrees").mkdir(parents=True)
    (built / "index.html").write_text("first", encoding="utf-8")
    with pytest.raises(SystemExit, match="gh-pages: expected a version"):
        put(site, "gh-pages", built)
    assert [each["preferred"] for each in put(site, "main", built)] == [True]
    for version in ("1.9.0", "1.10.0", "2.0.0rc1"):
        put(site, version, built)
    (built / "index.html").write_text("again", encoding="utf-8")
    offered = put(site, "1.9.0", built)
    assert offered == json.loads((site / "versions.json").read_text(encoding="utf-8"))
    assert [each["version"] for each in offered] == ["main", "2.0.0rc1", "1.10.0", "1.9.0"]
    assert [each["version"] for each in offered if each["preferred"]] == ["1.10.0"]
    assert 'url=1.10.0/"' in (site / "index.html").read_text(encoding="utf-8")
    assert (site / "1.9.0" / "index.html").read_text(encoding="utf-8") == "again"
    assert (site / "1.10.0" / "index.html").read_text(encoding="utf-8") == "first"
    assert not (site / "main" / ".doctrees").exists()
    with pytest.raises(SystemExit, match="found no index"):
        put(site, "3.0.0", tmp_path)


def test_every_picture_is_small_shown_and_made_by_a_script(repository: Path) -> None:
    docs = repository / "docs"
    files = (*docs.glob("figures/*.py"), *repository.glob("benchmarks/*.py"))
    scripts = "".join(file.read_text("utf-8") for file in files)
    shown = "".join(page.read_text("utf-8") for page in PAGES)
    pictures = [
        file for file in docs.rglob("figures/**/*") if file.suffix in (".png", ".svg", ".webp")
    ]
    assert len(pictures) > 10
    for picture in pictures:
        assert re.search(rf"\b{picture.stem}\b", scripts), picture
        assert picture.relative_to(docs).as_posix() in shown, picture
    assert sum(file.stat().st_size for file in docs.glob("figures/gallery/*")) < 2e6
