"""Every message that the code can write, as templates, by package."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from markdown_pieces import table
from repository_pages import ROOT

PACKAGE = ROOT / "suta_calib"
# A sentence has more words than a key, a name or a format.
FEWEST_WORDS = 4
PARTS = "found", "expected", "hint"


def messages_page() -> Iterator[str]:
    """Refusals with what was found, expected and to be done; then all other sentences."""
    yield "# All messages\n\n"
    yield (
        "This page is made from the code. A name in {braces} is filled in. A refusal is one "
        "line: `FILE:LINE: PLACE: found …; expected …; what to do`. [What does this message "
        "mean?](../guides/messages.md) explains the most frequent notes, the "
        "[glossary](../guides/glossary.md) the words.\n\n"
    )
    for package in sorted({file.relative_to(PACKAGE).parts[0] for file in files()}):
        refusals, sentences = [], []
        for file in files():
            if file.relative_to(PACKAGE).parts[0] == package:
                tree = ast.parse(file.read_text(encoding="utf-8"))
                refusals += list(refused(tree))
                sentences += list(said(tree))
        if not refusals and not sentences:
            continue
        yield f"## {package.removesuffix('.py')}\n\n"
        if refusals:
            yield table(("found", "expected", "what to do"), dict.fromkeys(refusals)) + "\n"
        yield "".join(f"* {sentence}\n" for sentence in dict.fromkeys(sentences)) + "\n"


def files() -> list[Path]:
    """All modules of the package."""
    return sorted(PACKAGE.rglob("*.py"))


def refused(tree: ast.Module) -> Iterator[tuple[str, str, str]]:
    """What was found, expected and is to be done, of every error that is made in a module."""
    for node in ast.walk(tree):
        if not is_error(node):
            continue
        given = dict(zip(PARTS[:2], map(template, node.args), strict=False))
        given |= {k.arg: template(k.value) for k in node.keywords if k.arg in PARTS}
        if any(given.values()):
            yield tuple(given.get(part, "") for part in PARTS)


def said(tree: ast.Module) -> Iterator[str]:
    """All other sentences of a module: notes, captions, what commands print."""
    not_shown: set[ast.AST] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            not_shown.add(body[0].value)  # a docstring
        if is_error(node):
            not_shown |= {
                inner for part in (*node.args, *node.keywords) for inner in ast.walk(part)
            }
        if isinstance(node, ast.JoinedStr):
            not_shown |= {inner for inner in ast.walk(node) if inner is not node}
    for node in ast.walk(tree):
        if node not in not_shown and isinstance(node, ast.JoinedStr | ast.Constant):
            sentence = template(node).strip()
            words = [word for word in sentence.split() if word.strip(".,:;()").isalpha()]
            if len(words) >= FEWEST_WORDS and not sentence.startswith(("<", "{", "$")):
                yield " ".join(sentence.split())


def is_error(node: ast.AST) -> bool:
    """Whether an error is made here."""
    name = ast.unparse(node.func).rpartition(".")[2] if isinstance(node, ast.Call) else ""
    return name.endswith("Error") and name not in ("ValueError", "TypeError")


def template(node: ast.expr) -> str:
    """A string with names in brackets for what is filled in; empty for anything else."""
    if isinstance(node, ast.Constant):
        return escaped(node.value) if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(
            escaped(part.value) if isinstance(part, ast.Constant) else filled(part.value)
            for part in node.values
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return template(node.left) + template(node.right)
    if isinstance(node, ast.IfExp):
        return " / ".join(filter(None, (template(node.body), template(node.orelse))))
    return filled(node)


def filled(node: ast.expr) -> str:
    """What is filled in, by its last name."""
    names = [
        n.attr if isinstance(n, ast.Attribute) else n.id
        for n in ast.walk(node)
        if isinstance(n, ast.Attribute | ast.Name)
    ]
    return "{" + names[0].strip("_").replace("_", " ") + "}" if names else "…"


def escaped(text: str) -> str:
    """Without what Markdown would take for itself."""
    for sign in "\\`*_[]<>|$":
        text = text.replace(sign, f"\\{sign}")
    return text.replace("\n", " ")
