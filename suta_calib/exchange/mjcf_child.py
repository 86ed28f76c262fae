"""The process in which MuJoCo reads a model: ``python -m suta_calib.exchange.mjcf_child FILE``.

MuJoCo compiles the file: includes, defaults, frames, attached and replicated parts, angles and
orientations in every spelling mean what they mean to it. What plays no part in where bodies and
sites are is taken out before: masses and shapes, whose meshes and textures need not be there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any, Final

import mujoco
import numpy as np

from suta_calib.sandbox import answer

_SHAPES: Final = (
    *("keys", "sensors", "actuators", "equalities", "tendons", "pairs", "excludes", "tuples"),
    *("numerics", "texts", "skins", "flexes", "geoms", "cameras", "lights", "hfields"),
    *("meshes", "materials", "textures"),
)


def _compiled(path: str) -> tuple[Any, bool]:
    """The model, and whether it couples joints or bodies, which its kinematics does not heed."""
    spec = mujoco.MjSpec.from_file(path)
    bodies = spec.bodies
    most_bodies = 5000
    if len(bodies) > most_bodies:
        raise ValueError(f"{len(bodies)} bodies; expected at most {most_bodies}")
    coupled = bool(spec.equalities)
    # Where the file asks for it a floating body is moved into its centre of mass: shapes matter.
    aligned = spec.compiler.alignfree or any(joint.align == 1 for joint in spec.joints)
    spec.compiler.fusestatic = 0
    # Room for contacts, which are not looked for.
    spec.memory = spec.njmax = spec.nconmax = spec.nstack = -1
    for name in _SHAPES if not aligned else ():
        for element in list(getattr(spec, name)):
            spec.delete(element)
    for site in spec.sites if not aligned else ():
        site.material = ""
    for body in bodies[1:] if not aligned else ():
        body.explicitinertial = 1
        body.mass, body.ipos, body.iquat = 1.0, np.zeros(3), [1, 0, 0, 0]
        body.inertia, body.fullinertia = np.ones(3), np.full(6, np.nan)
    return spec.compile(), coupled


def _read(path: str) -> dict[str, Any]:
    try:
        model, coupled = _compiled(path)
    except MemoryError:
        raise
    # MuJoCo raises ValueError, but what a file makes of it may raise anything.
    except Exception as problem:  # noqa: BLE001
        return {"refused": " ".join(str(problem).split())}
    return {
        "model": model.names[: model.names.index(b"\0")].decode(errors="replace"),
        "version": mujoco.__version__,
        "coupled": coupled,
        "bodies": _elements(
            *(model, "body", model.nbody),
            parent=model.body_parentid,
            pos=model.body_pos,
            quat=model.body_quat,
            mocap=model.body_mocapid >= 0,
        ),
        "joints": _elements(
            *(model, "joint", model.njnt),
            body=model.jnt_bodyid,
            kind=model.jnt_type,
            pos=model.jnt_pos,
            axis=model.jnt_axis,
            ref=model.qpos0[model.jnt_qposadr],
            pose=[model.qpos0[at:][:7] for at in model.jnt_qposadr],
            range=[
                ends if limited else None
                for ends, limited in zip(model.jnt_range, model.jnt_limited, strict=True)
            ],
        ),
        "sites": _elements(
            *(model, "site", model.nsite),
            body=model.site_bodyid,
            pos=model.site_pos,
            quat=model.site_quat,
        ),
        "postures": list(_postures(model)),
    }


def _elements(model: Any, kind: str, count: int, /, **fields: Any) -> list[dict[str, Any]]:
    """The name, and some fields, of each body, joint or site."""
    number = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    fields["name"] = [mujoco.mj_id2name(model, number, k) or "" for k in range(count)]
    rows = zip(*fields.values(), strict=True)
    return [
        {
            field: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
            for field, value in zip(fields, row, strict=True)
        }
        for row in rows
    ]


def _postures(model: Any) -> Iterator[dict[str, Any]]:
    """Where MuJoCo has every body and site with joints of one axis anywhere in their range."""
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
    # Joints without limits go so far, rad or m.
    lower, upper = np.where(model.jnt_limited[:, None], model.jnt_range, [-2.0, 2.0]).T
    for _ in range(3):
        readings = random.uniform(lower, upper)
        data.qpos[model.jnt_qposadr[single]] = readings[single]
        mujoco.mj_kinematics(model, data)
        yield {
            "readings": readings.tolist(),
            "bodies": np.hstack([data.xpos, data.xmat]).tolist(),
            "sites": np.hstack([data.site_xpos, data.site_xmat]).tolist(),
        }


if __name__ == "__main__":
    # Otherwise MuJoCo writes its warnings into a file where the user works.
    mujoco.set_mju_user_warning(lambda _: None)
    answer(lambda: _read(sys.argv[1]))
