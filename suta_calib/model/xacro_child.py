"""The process that expands a ``.xacro`` file: ``python -m … FILE [NAME:=VALUE …]``.

xacro itself expands it, with three parts exchanged: expressions are computed by
`suta_calib.model.xacro_expressions`, packages are found without ROS, and files are read only from
the folders of the description. Should something get past that, a hook of the interpreter still
refuses every other file, process, connection and import.
"""

from __future__ import annotations

import os
import re
import stat
import sys
import xml.dom.expatbuilder
import xml.dom.minidom
from collections import ChainMap
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import xacro
import yaml
from xacro import substitution_args

from suta_calib.model.xacro_expressions import Evaluator, ExpressionError, Function
from suta_calib.sandbox import answer

_MANIFEST: Final = "package.xml"
_ARGUMENT: Final = re.compile(rb"""<xacro:arg\s[^>]*?name\s*=\s*["']([^"']+)|\$\(arg\s+([^)\s]+)""")
_NAME: Final = re.compile(rb"<name>\s*([\w.-]+)\s*</name>")
# Of what the interpreter reports, this is harmless; the folders of what it reads are looked at.
_HARMLESS: Final = frozenset(
    ("compile", "object.__getattr__", "sys._getframe", "builtins.id", "glob.glob", "glob.glob/2")
)
_FOLDERS: Final = frozenset(("os.listdir", "os.scandir"))


class RefusedError(Exception):
    """What a file may not do."""


class Description:
    """The folders that belong to a description, and its packages.

    A description is the package that the file is in (the nearest folder above it with a
    ``package.xml``), or else the file's folder. Packages beside it, or in the folder, belong to it
    as soon as the file asks for them by their names.
    """

    def __init__(self, file: Path) -> None:
        # Of a workspace of links, both where the link is and where it leads.
        starts = {Path(os.path.abspath(file)).parent, file.resolve().parent}  # noqa: PTH100
        self.folders = [_package_above(start) or start for start in starts]
        self.files: list[str] = []
        self._packages: dict[str, Path] = {}
        for folder in self.folders:
            package = (folder / _MANIFEST).is_file()
            beside = (folder.parent, folder.parent.parent) if package else ()
            for manifest in (folder / _MANIFEST, *_manifests(folder, *beside)):
                if name := _package_name(manifest):
                    self._packages.setdefault(name, manifest.parent)

    def find(self, package: str) -> str:
        """The folder of a package, which belongs to the description from now on."""
        if package not in self._packages:
            where = ", ".join(map(str, self.folders))
            raise RefusedError(f"no package {package!r} in {where} or next to it")
        folder = self._packages[package]
        self.folders.append(folder)
        return str(folder)

    def check(self, path: str, *, folder: bool = False) -> None:
        """Refuse a file (or folder) that is not the description's, is no plain file, or is huge."""
        real = Path(os.path.realpath(path))
        if not any(real.is_relative_to(folder.resolve()) for folder in self.folders):
            inside = ", ".join(dict.fromkeys(map(str, self.folders)))
            raise RefusedError(f"{path}, which is outside the description ({inside})")
        if folder or not real.exists():
            return
        status = real.stat()
        if not stat.S_ISREG(status.st_mode):
            raise RefusedError(f"{path}, which is not a file")
        largest = 16 << 20
        if status.st_size > largest:
            raise RefusedError(f"{path}, of {status.st_size} bytes")
        self.files.append(str(real))


def _package_above(folder: Path) -> Path | None:
    return next(
        (parent for parent in (folder, *folder.parents) if (parent / _MANIFEST).is_file()), None
    )


def _manifests(*folders: Path) -> Iterator[Path]:
    # More folders beside a package than in any installation are not looked through.
    most_packages = 3000
    for folder in folders:
        try:
            names = sorted(entry.name for entry in os.scandir(folder) if entry.is_dir())
        except OSError:
            continue
        yield from (folder / name / _MANIFEST for name in names[:most_packages])


def _package_name(manifest: Path) -> str:
    try:
        with manifest.open("rb") as file:
            match = _NAME.search(file.read(4096))
    except OSError:
        return ""
    return match[1].decode() if match else ""


def _confine(description: Description) -> None:
    """Let this process do nothing any more but read the description's files."""

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in _HARMLESS or event.startswith("cpython."):
            return
        if event == "open":
            path, mode, flags = arguments
            writing = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            if isinstance(path, int) or flags & writing or set(mode or "r") & set("wax+"):
                raise RefusedError(f"an attempt to write a file: {path}")
            description.check(os.fsdecode(path))
        elif event in _FOLDERS:
            description.check(os.fsdecode(arguments[0] or "."), folder=True)
        else:
            raise RefusedError(f"an action that no description needs: {event}")

    sys.addaudithook(hook)


def _exchange_parts(description: Description) -> None:
    """Give xacro our expressions, packages and files."""
    table = xacro._global_symbols
    # One argument alone: with three it makes classes.
    table["python"]["type"] = Function(lambda value: type(value))  # noqa: PLW0108
    table["python"].pop("vars", None)
    spaces = [space for space in table.values() if isinstance(space, xacro.NameSpace)]
    offered = [value for space in (table, *spaces) for value in space.values()]
    evaluator = Evaluator(
        [value for value in offered if callable(value)],
        namespaces=(xacro.NameSpace,),
        dotted=(xacro.YamlDictWrapper,),
    )

    def safe_eval(text: str, names: Any, local: Any = None) -> Any:
        return evaluator.evaluate(text, names if local is None else ChainMap(local, names))

    def eval_command(text: str, context: Any) -> str:
        values = context.setdefault("arg", {})
        functions: dict[str, Any] = {
            "arg": lambda name: substitution_args.convert_value(values[name], "auto"),
            "find": description.find,
            "env": environment,
            "optenv": optional_environment,
        }
        names: Any = {name: Function(function) for name, function in functions.items()}
        names |= {"true": True, "false": False, "True": True, "False": False}
        given = {k: substitution_args.convert_value(v, "auto") for k, v in values.items()}
        return str(evaluator.evaluate(text, ChainMap(names, given, table)))

    def environment(_name: str) -> str:
        raise RefusedError("the environment, which a .xacro cannot read here")

    def optional_environment(_name: str, default: str = "") -> str:
        return default

    @cache
    def contents(path: str) -> bytes:
        with open(path, "rb") as file:  # noqa: PTH123
            return file.read()

    def parse(text: Any, filename: str | None = None) -> Any:
        if text is None:
            try:
                text = contents(os.path.join(xacro.root_dir, str(filename)))  # noqa: PTH118
            except OSError as problem:
                xacro.filestack.pop()
                message = f"{problem.strerror}: {filename}"
                raise xacro.XacroException(message, exc=problem) from None
        return xml.dom.minidom.parseString(text)

    xacro.safe_eval, xacro.parse = safe_eval, parse
    substitution_args._eval = eval_command
    substitution_args._eval_env = environment
    substitution_args._eval_optenv = optional_environment
    substitution_args._eval_find = description.find


def _expand(path: str, given: dict[str, str], description: Description) -> dict[str, Any]:
    _confine(description)
    try:
        urdf = xacro.process_file(path, mappings=given).toprettyxml(indent="  ")
        files = sorted(set(description.files))
        arguments = {name for file in files for name in _arguments_of(file)}
        return {"urdf": urdf, "files": files, "arguments": sorted(arguments)}
    except MemoryError:
        raise
    # Whatever stands in the file's expressions may raise whatever it likes.
    except Exception as problem:  # noqa: BLE001
        # What went wrong first, without what xacro says around it.
        first: BaseException = problem
        while (inner := getattr(first, "exc", None)) is not None:
            first = inner
        if isinstance(first, MemoryError):
            raise first from None
        forbidden = isinstance(first, RefusedError | ExpressionError)
        kind = "" if forbidden or isinstance(first, xacro.XacroException) else type(first).__name__
        text = " ".join(str(first).split())
        match = re.search(r"when evaluating expression '(.*?)'\s*\Z", str(problem), re.DOTALL)
        return {
            "refused": f"{kind}: {text}" if kind else text,
            "forbidden": forbidden,
            "file": str((xacro.filestack or [path])[-1] or path),
            "expression": match[1] if match else "",
        }


def _arguments_of(path: str) -> Iterator[str]:
    """Names of the arguments that a file declares or uses."""
    with open(path, "rb") as file:  # noqa: PTH123
        for declared, used in _ARGUMENT.findall(file.read()):
            yield (declared or used).decode(errors="replace")


if __name__ == "__main__":
    file, *values = sys.argv[1:]
    given = {name: value for name, _, value in (text.partition(":=") for text in values)}
    description = Description(Path(file))
    _exchange_parts(description)
    # YAML with units registers its tags when it is first asked for.
    for unit in xacro.ConstructUnits:
        yaml.SafeLoader.add_constructor(unit.value.tag, unit.constructor)
    answer(lambda: _expand(file, given, description))
