"""The page of other programs' files: what their readers and writers say of themselves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from markdown_pieces import anchor, sentence, table

from suta_calib.exchange import export_formats, import_formats
from suta_calib.exchange.option import Described
from suta_calib.registry import shipped

TITLES = {"import": "What can be imported", "export": "What can be exported"}


def formats() -> dict[str, Mapping[str, Described]]:
    """Formats by name, by the command that takes them."""
    return {"import": shipped(import_formats()), "export": shipped(export_formats())}


def formats_page() -> Iterator[str]:
    """Every format: what it is, an example, its options."""
    yield "# Other programs' files\n\n"
    yield (
        "The formats that `suta-calib import --list` and `suta-calib export --list` show, with "
        "their options. [View, import, export](../guides/exchange.md) shows how to use "
        "them.\n\n"
    )
    for command, known in formats().items():
        yield f"## {TITLES[command]}\n\n"
        yield table(
            ("format", ""),
            ((f"[`{n}`](#{command}-{anchor(n)})", sentence(f.summary)) for n, f in known.items()),
        )
        for name, each in known.items():
            yield f"({command}-{anchor(name)})=\n### {name}\n\n{sentence(each.summary)}"
            yield f" Needs `suta_calib[{each.extra}]`.\n\n" if each.extra else "\n\n"
            yield f"```text\nsuta-calib {command} {each.example}\n```\n\n"
            if each.options:
                yield table(("option", ""), ((f"`{o.switch}`", o.help) for o in each.options))
