"""Options that commands share; numbers are finite, and in mm where they are places."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import click
import numpy as np

from suta_calib.atomic import check_folder
from suta_calib.errors import OutputError
from suta_calib.inputs import UrdfFile, XacroFile
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.scale import INSTRUMENT_PPM
from suta_calib.model.arm import ArmModel
from suta_calib.report.files import results_for
from suta_calib.units import from_mm

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray
    from suta_calib.model.arm import ArmModel


Command = TypeVar("Command", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """`click.FloatRange` that refuses ``nan``, which is out of no range, and ``inf`` too."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number, or a usage error that says what was found."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"found {value!r}; expected a finite number", param, ctx)
        return number


class Folder(click.Path):
    """A folder to write into, checked before any work is done."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The folder, which may be yet to be made."""
        folder = Path(str(super().convert(value, param, ctx)))
        check_folder(folder)
        return folder


class NewFile(click.Path):
    """A file to write into a folder that is there, checked before any work is done."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The file, which may be there already."""
        file = Path(str(super().convert(value, param, ctx)))
        if not file.parent.is_dir() or file.is_dir():
            what = "a folder" if file.is_dir() else f"no folder {file.parent}"
            expected = "a file name in an existing folder"
            raise OutputError(f"{file}: found {what}; expected {expected}")
        check_folder(file.parent)
        return file


class NamedFile(NamedTuple):
    """A file, and the name that it was given: empty without one."""

    name: str
    path: Path


def _named_file(value: str) -> NamedFile:
    """``FILE``, or ``NAME=FILE``; a file whose own name has the sign is one without a name."""
    name, sign, path = value.partition("=")
    if not sign or not name or Path(value).exists():
        return NamedFile("", Path(value))
    return NamedFile(name, Path(path))


NAMED: Final = click.types.FuncParamType(_named_file)
NAMED.name = "[NAME=]FILE"
# A file or folder that is read, and a file that is written.
PATH: Final = click.Path(path_type=Path)
WRITTEN: Final = NewFile()
POSITIVE: Final = FiniteRange(min=0, min_open=True)


def option(
    switch: str, about: str, kind: Any = None, default: Any = None, *, name: str = "", **more: Any
) -> Callable[[Command], Command]:
    """An option of a command.

    Args:
        switch: as it is written, such as ``--report DIR``; the type says what its value is called
            where nothing stands behind it.
        about: what ``--help`` says.
        kind: type of the value; that of the default, or a text, by default.
        default: of the value; an empty text is not shown.
        name: of the parameter, where it is not that of the switch.
        more: as of `click.option`.
    """
    words, _, metavar = switch.partition(" ")
    more |= {"type": kind} if kind is not None else {}
    more |= {"metavar": metavar} if metavar else {}
    more |= {"default": default} if default is not None else {}
    more |= {"show_default": False} if default == "" else {}
    return click.option(words, *filter(None, (name,)), help=about, **more)


def flag(switch: str, about: str, *, name: str = "") -> Callable[[Command], Command]:
    """An option without a value: it is given or not."""
    return option(switch, about, name=name, is_flag=True)


def length_unit(value: str) -> float:
    """How many m one step of the depth is: a unit by its name, or a number."""
    step = {"mm": 1e-3, "m": 1.0}.get(value) or number_in(value)
    # From a micrometre to a metre.
    if not 1e-6 <= step <= 1.0:
        raise click.BadParameter(f"found {value!r}; expected mm, m, or the m of a step: 0.0002")
    return step


def numbers_of(text: str) -> list[float]:
    """Finite numbers with commas between them; none where there is anything else."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def _place(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> FloatArray | None:
    """As many finite numbers as the option's metavar names, with commas between them, in m."""
    if value is None:
        return None
    names, numbers = str(parameter.metavar), numbers_of(value)
    if len(numbers) != names.count(",") + 1:
        raise click.BadParameter(f"found {value!r}; expected {names} in mm", context, parameter)
    place = from_mm(np.array(numbers))
    # Six are a lower and an upper corner, (2, 3).
    return place.reshape(3, 2).T if len(place) == 6 else place


def _results(context: click.Context, parameter: click.Parameter, out: Path | None) -> Path:
    del parameter
    return results_of(context.params["job"], out)


def results_of(job: Path, out: Path | None) -> Path:
    """Where the answer on a job, or on a result.json, is written; each job has its own folder.

    Args:
        job: the file, or a folder of results.
        out: what ``--out`` names.

    Raises:
        OutputError: nothing can be written there.
    """
    if out is None:
        out = results_for(job)
    check_folder(out)
    return out


# Eager: the folder of results follows from it, wherever it stands on the command line.
job_argument = click.argument("job", type=PATH, metavar="JOB", is_eager=True)
out_option = option(
    "--out", "Folder for the results; default: results/ next to the job.", PATH, callback=_results
)
json_option = flag("--json", "Print one JSON object instead of text.", name="as_json")
anyway_option = flag("--anyway", "Use a calibration even if its verdict is bad.")
verbose_option = click.option("-v", "--verbose", is_flag=True, help="Show all tables.")
region_option = option(
    "--region X0,X1,Y0,Y1,Z0,Z1",
    "Region in which the tip works, in mm; default: around the touched points.",
    callback=_place,
)
place_option = option(
    "--register-at X,Y,Z", "Point in mm around which the registration is done.", callback=_place
)
# Without it an instrument is taken for a good one.
scale_option = option(
    "--scale-ppm PPM",
    "Standard deviation of the scale factor of all measured lengths; default "
    f"{INSTRUMENT_PPM:g}. The residuals do not show this factor, so every ± includes it.",
    FiniteRange(min=0, max=1e5),
    INSTRUMENT_PPM,
)


def _xacro_arguments(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> None:
    """Keep ``NAME:=VALUE`` for the URDF of the command, which is read after it."""
    given = dict[str, str]()
    for text in values:
        name, assigned, value = text.partition(":=")
        if not name or not assigned or name in given:
            expected = "NAME:=VALUE, each name once"
            raise click.BadParameter(f"found {text!r}; expected {expected}", context, parameter)
        given[name] = value
    context.meta[_xacro_arguments.__name__] = given


def _urdf_file(
    context: click.Context, parameter: click.Parameter, path: Path | None
) -> UrdfFile | None:
    """A URDF, or a ``.xacro`` file with its arguments."""
    del parameter
    given = context.meta.get(_xacro_arguments.__name__)
    if given and path is None:
        raise click.UsageError("--xacro-arg is for a .xacro file: give it with --urdf")
    return XacroFile(path, given) if given and path is not None else path


_xacro_option = option(
    "--xacro-arg NAME:=VALUE",
    "Value of an argument of a .xacro file, given instead of a URDF; may be repeated.",
    multiple=True,
    # The URDF needs it, wherever it stands on the command line.
    is_eager=True,
    expose_value=False,
    callback=_xacro_arguments,
)


def urdf_argument(metavar: str, name: str = "urdf") -> Callable[[Command], Command]:
    """The argument that is a URDF, or a ``.xacro`` file with ``--xacro-arg``."""
    argument = click.argument(name, type=PATH, metavar=metavar, callback=_urdf_file)
    return lambda command: argument(_xacro_option(command))


def urdf_option(about: str) -> Callable[[Command], Command]:
    """``--urdf``, a URDF, or a ``.xacro`` file with ``--xacro-arg``."""
    urdf = option("--urdf", about, PATH, callback=_urdf_file)
    return lambda command: urdf(_xacro_option(command))


def chain_option(command: Command) -> Command:
    """``--chain``, for what looks at one tip."""
    return option("--chain", "Chain of the job's robot, where it has several.", default="")(command)


def seed_option(of: str) -> Callable[[Command], Command]:
    """``--seed``, whose help says what is drawn with it."""
    return option("--seed", of, click.IntRange(min=0), 0)


def pose_options(command: Command) -> Command:
    """``--out``, ``--no-robust`` and ``--seed``."""
    least_squares = "Use plain least squares with all rows, without searching for outliers."
    for decorate in (
        seed_option("Seed of the random samples in the search for outliers."),
        flag("--no-robust", least_squares, name="plain"),
        option("--out", "Folder for the results.", Folder()),
    ):
        command = decorate(command)
    return command


def certify_option(command: Command) -> Command:
    """``--certify``: the answer is given what is proven of it (`with_proof`)."""
    about = "Prove that no other answer fits better, or say that it is not proven."
    return flag("--certify", about)(command)


def optional_arm(
    urdf: UrdfFile | None, tip: str | None, base: str | None, what: str
) -> ArmModel | None:
    """The arm of ``--urdf``, ``--tip`` and ``--base``, whose tip did ``what``; None without."""
    if urdf is None:
        if tip or base:
            raise click.UsageError(
                "--tip and --base are frames of an arm: give the arm with --urdf"
            )
        return None
    if tip is None:
        raise click.UsageError(f"--urdf needs --tip: the link or frame that {what}")

    return ArmModel.from_urdf(urdf, tip, base)


def page_options(command: Command) -> Command:
    """``--port``, ``--host`` and ``--no-open`` of a page in the browser."""
    where = (
        "Address of the page. Default: only this computer can look; with 0.0.0.0 everybody in the "
        "network who has the printed address, such as a tablet."
    )
    port = click.IntRange(0, 65535)
    for decorate in (
        flag("--no-open", "Do not open the page in a browser."),
        option("--host ADDRESS", where, default="127.0.0.1"),
        option("--port", "Port of the page; 0 for any free port.", port, 8080),
    ):
        command = decorate(command)
    return command
