"""What a .xacro file may not do: run, read, ask, wait, or fill the memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from suta_calib import sandbox
from suta_calib.errors import UrdfError
from suta_calib.model.xacro_expressions import Evaluator, ExpressionError, Function
from suta_calib.model.xacro_file import expanded
from suta_calib.sandbox import ConfinedError, run_confined

pytest.importorskip("xacro")

HEAD = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def written(path: Path, body: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{HEAD}{body}</robot>", encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(UrdfError) as caught:
        expanded(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message


# ── expressions ──────────────────────────────────────────────────────────────────────────────
@pytest.fixture
def evaluator() -> Evaluator:
    return Evaluator([len, str, map, list, dict, range, sorted, max, min, zip])


NAMES = {
    "len": len,
    "str": str,
    "map": map,
    "list": list,
    "dict": dict,
    "range": range,
    "sorted": sorted,
    "max": max,
    "zip": zip,
    "x": 2.5,
    "d": {"a": [1, 2], "b": {"c": "text"}},
    "f": Function(lambda a, b=1: a + b),
}


@pytest.mark.parametrize(
    "text",
    [
        "1 + 2*x - 3**2 / 4 // 1 % 5",
        "-x if x > 2 and not x == 3 else +x",
        "1 < x <= 2.5 != 7",
        "d['a'][0] + d['a'][-1] + len(d['b'])",
        "'%.3f %s' % (x, 'm') + '{:>6.2f}{}'.format(x, 1) + '{0[a]}'.format(d)",
        "f'{x:.2f} {d!r:>40}'",
        "[2*i for i in range(5) if i % 2] + list(map(lambda v: v + 1, d['a']))",
        "{k: v for k, v in d.items()}['a'], {i for i in (1, 2)}, {**d, 'e': 1}",
        "sorted([3, 1, 2], key=lambda v: -v)[:2][::-1]",
        "' a b '.strip().split(' ')[1].upper().replace('B', 'c').startswith('c')",
        "[(a, b) for a, b in zip([1, 2], [3, 4]) for c in [0]]",
        "max(*d['a'], 7) in [7, None] or 'a' not in 'bc'",
        "0x1F | 1 & ~2 ^ 3, 2**-1, 10**3, 'ab' * 3, x is None, None or 'z'",
        "d.get('q', 4)",
        "f(1, b=2)",
        "(lambda a, b: a * b)(2, 3)",
    ],
)
def test_what_descriptions_compute_is_what_python_computes(evaluator: Evaluator, text: str) -> None:
    assert evaluator.evaluate(f" {text} ", NAMES) == eval(text, dict(NAMES))


@pytest.mark.parametrize(
    "text",
    [
        "().__class__.__bases__[0].__subclasses__()",
        "''.__class__",
        "(lambda: 0).__globals__",
        "(lambda: 0).gi_frame",
        "[i for i in [1]].gi_frame.f_back",
        "(i for i in [1]).gi_frame",
        "'{0.__class__}'.format(x)",
        "'{0.real}'.format(d)",
        "'{a.__class__.__mro__}'.format(a=x)",
        "f'{x.__class__}'",
        "str.mro()",
        "'abc'.encode()",
        "'{}'.format_map(d)",
        "f.__call__.__globals__",
        "f._call",
        "open('/etc/passwd')",
        "d['a'].sort.__self__",
        "d.fromkeys",
        "__import__('os')",
        "(y := 1)",
        "lambda *a: a",
        "f[0]",
        "1 @ 2",
        "10 ** 10 ** 10",
        "'a' * 10**9",
        "10**9 * [1]",
        "1 << 10**9",
        "x if " + "(" * 200 + "1" + ")" * 200 + " else " + "x" * 10_000,
    ],
)
def test_what_leads_out_of_an_expression_is_not_computed(evaluator: Evaluator, text: str) -> None:
    started = time.process_time()
    with pytest.raises((ExpressionError, NameError, SyntaxError, MemoryError, RecursionError)):
        evaluator.evaluate(text, NAMES)
    assert time.process_time() - started < 1.0


# ── files ────────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize(
    ("body", "says"),
    [
        (
            '<link name="${(lambda: 0).__globals__}"/>',
            "arm.xacro:1: found something that xacro may not do here (the attribute '__globals__'",
        ),
        ("<link name=\"${xacro.load_yaml('SECRET')}\"/>", "secret.yaml, which is outside the"),
        ("<link name=\"${load_yaml('../secret.yaml')}\"/>", "which is outside the description"),
        ("<link name=\"${xacro.load_yaml('link.yaml')}\"/>", "which is outside the description"),
        ('<xacro:include filename="SECRET"/>', "which is outside the description"),
        ('<xacro:include filename="../*"/>', "which is outside the description"),
        ('<xacro:include filename="/dev/zero"/>', "which is outside the description"),
        ('<xacro:include filename="pipe"/>', "pipe, which is not a file"),
        ('<link name="$(env HOME)"/>', "the environment, which a .xacro cannot read here"),
        ("<link name=\"$(eval env['HOME'])\"/>", "an element of Function"),
        ('<link name="$(eval [].append.real)"/>', "the attribute 'real'"),
        ('<link name="$(find nowhere)"/>', "no package 'nowhere' in "),
        ("<link name=\"${'a' * 10**9}\"/>", "a sequence of more than 1000000 elements"),
        ("<link name=\"${'a'.ljust(4 * 10**9)}\"/>", "takes more memory than a description needs"),
    ],
)
def test_refusals(tmp_path: Path, body: str, says: str) -> None:
    folder = tmp_path / "description"
    secret = tmp_path / "secret.yaml"
    secret.write_text("word: hidden\n")
    arm = written(folder / "arm.xacro", body.replace("SECRET", str(secret)))
    (folder / "link.yaml").symlink_to(secret)
    os.mkfifo(folder / "pipe")
    started = time.monotonic()
    message = refusal(arm)
    assert says in message
    assert "hidden" not in message
    assert "expand it yourself" in message
    assert time.monotonic() - started < 10


def test_nothing_is_run_or_written_and_nothing_is_learnt(tmp_path: Path) -> None:
    """The process that expands refuses it by itself too, whatever an expression has reached."""
    secret = tmp_path / "secret"
    secret.write_text("hidden")
    arm = written(tmp_path / "description" / "arm.xacro", "")
    attempts = (
        f"open({str(secret)!r}).read()",
        f"open({str(arm)!r}, 'a')",
        f"os.open({str(tmp_path / 'new')!r}, os.O_CREAT)",
        f"os.system('touch {tmp_path / 'new'}')",
        "os.fork()",
        "subprocess.run(['true'])",
        "__import__('wave')",
        "eval('1')",
        "os.listdir('/')",
        "__import__('socket').socket()",
        f"os.remove({str(secret)!r})",
        f"os.mkdir({str(tmp_path / 'new')!r})",
    )
    program = (
        "import os, sys, subprocess, socket\nfrom pathlib import Path\n"
        "from suta_calib.model import xacro_child as child\n"
        "arm = Path(sys.argv[1])\nattempts = [compile(a, 'a', 'eval') for a in sys.argv[2:]]\n"
        "run = eval\nchild._confine(child.Description(arm))\n"
        "assert open(arm).read()\n"
    )
    for k, attempt in enumerate(attempts):
        program += f"try:\n    {attempt}\n    print({k})\nexcept child.RefusedError: pass\n"
    program += "print('end', flush=True)\nos._exit(0)\n"
    run = subprocess.run(
        [sys.executable, "-c", program, str(arm), *attempts],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.stdout, run.returncode) == ("end\n", 0), run.stderr
    assert secret.read_text() == "hidden"
    assert not (tmp_path / "new").exists()


def test_what_does_not_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the clock; and by the processor's, which this module sets in the child."""
    endless = "<xacro:macro name='m'><xacro:m/><xacro:m/></xacro:macro>"
    body = "".join(
        f"<xacro:macro name='m{k}'><xacro:m{k + 1}/><xacro:m{k + 1}/></xacro:macro>"
        for k in range(60)
    )
    arm = written(tmp_path / "a.xacro", f"{body}<xacro:macro name='m60'/><xacro:m0/>")
    with pytest.raises(ConfinedError, match=r"more than 0\.8 s"):
        run_confined("suta_calib.model.xacro_child", str(arm), seconds=0.8)
    assert "xacro refuses (RecursionError" in refusal(
        written(tmp_path / "b.xacro", f"{endless}<xacro:m/>")
    )
    assert sandbox.PROCESSOR_SECONDS <= 10


def test_a_description_reads_its_package_and_those_beside_it(tmp_path: Path) -> None:
    """By name, as ROS finds them, but without ROS."""
    for name in ("arm_description", "common"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    (tmp_path / "arm_description/config").mkdir()
    (tmp_path / "arm_description/config/a.yaml").write_text("arm: {angle: !degrees 90, n: [1, 2]}")
    written(tmp_path / "common/part.xacro", '<xacro:property name="width" value="0.25"/>')
    arm = written(
        tmp_path / "arm_description/urdf/arm.xacro",
        '<xacro:arg name="side" default="left"/>'
        '<xacro:include filename="$(find common)/part.xacro"/>'
        '<xacro:property name="k" value="${xacro.load_yaml(\'$(find arm_description)/config/'
        "a.yaml')['arm']}\"/>"
        "<link name=\"$(arg side)_${k.n[1]}_${width}_${round(k['angle'], 3)}_"
        '${python.abs(-1)}_${math.floor(radians(180))}_$(optenv HOME none)"/>'
        "<xacro:if value=\"${'$(arg side)' == 'left'}\"><link name=\"l\"/></xacro:if>",
    )
    text = expanded(arm).decode()
    assert '<link name="left_2_0.25_1.571_1_3_none"/>' in text
    assert '<link name="l"/>' in text
    # What was read is read again when it changes, and once otherwise.
    written(tmp_path / "common/part.xacro", '<xacro:property name="width" value="0.375"/>')
    assert "left_2_0.375_" in expanded(arm).decode()


def test_an_argument_without_a_value_is_named(tmp_path: Path) -> None:
    arm = written(tmp_path / "a.xacro", '<xacro:arg name="n" default=""/><link name="$(arg who)"/>')
    message = refusal(arm)
    assert "no value of the argument 'who'" in message
    assert "NAME:=VALUE" in message
