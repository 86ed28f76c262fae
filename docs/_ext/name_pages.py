"""Commands as ``--help`` tells them, and every public name of the package."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module

import click
from markdown_pieces import first_code, table

import suta_calib
from suta_calib.cli._app import COMMANDS, PROGRAM, app

# Characters in a line of help, so that a telephone shows most of it.
HELP_WIDTH = 88


def commands_page() -> Iterator[str]:
    """What ``--help`` says of every command, at the width of a text."""
    yield "# Commands\n\n"
    yield (
        "The `--help` text of each command. The exit code is 0 if the command is done, 1 if it is "
        "done but the result must not be used, and 2 for wrong usage or input.\n\n"
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
    yield "[Every name of `suta_calib` by task](../guides/python.md), with examples.\n\n"
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
