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

from suta_calib.confined import answer

# Postures in which the URDF must agree with MuJoCo, and how far joints without limits go, rad or m.
_POSTURES: Final = 3
_RANGE: Final = 2.0
_MOST_BODIES: Final = 5000
_SHAPES: Final = (
    *("keys", "sensors", "actuators", "equalities", "tendons", "pairs", "excludes", "tuples"),
    *("numerics", "texts", "skins", "flexes", "geoms", "cameras", "lights", "hfields"),
    *("meshes", "materials", "textures"),
)


def _compiled(path: str) -> tuple[Any, bool]:
    """The model, and whether it couples joints or bodies, which its kinematics does not heed."""
    spec = mujoco.MjSpec.from_file(path)
    bodies = spec.bodies
    if len(bodies) > _MOST_BODIES:
        raise ValueError(f"{len(bodies)} bodies; expected at most {_MOST_BODIES}")
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
    names = {kind: [_name(model, k, kind) for k in range(n)] for kind, n in _counts(model).items()}
    return {
        "model": model.names[: model.names.index(b"\0")].decode(errors="replace"),
        "version": mujoco.__version__,
        "coupled": coupled,
        "bodies": [
            {
                "name": names["body"][k],
                "parent": int(model.body_parentid[k]),
                "pos": model.body_pos[k].tolist(),
                "quat": model.body_quat[k].tolist(),
                "mocap": bool(model.body_mocapid[k] >= 0),
            }
            for k in range(model.nbody)
        ],
        "joints": [
            {
                "name": names["joint"][k],
                "body": int(model.jnt_bodyid[k]),
                "kind": int(model.jnt_type[k]),
                "pos": model.jnt_pos[k].tolist(),
                "axis": model.jnt_axis[k].tolist(),
                "ref": float(model.qpos0[model.jnt_qposadr[k]]),
                "pose": model.qpos0[model.jnt_qposadr[k] :][:7].tolist(),
                "range": model.jnt_range[k].tolist() if model.jnt_limited[k] else None,
            }
            for k in range(model.njnt)
        ],
        "sites": [
            {
                "name": names["site"][k],
                "body": int(model.site_bodyid[k]),
                "pos": model.site_pos[k].tolist(),
                "quat": model.site_quat[k].tolist(),
            }
            for k in range(model.nsite)
        ],
        "postures": list(_postures(model)),
    }


def _counts(model: Any) -> dict[str, int]:
    return {"body": model.nbody, "joint": model.njnt, "site": model.nsite}


def _name(model: Any, k: int, kind: str) -> str:
    name = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), k)
    return str(name or "")


def _postures(model: Any) -> Iterator[dict[str, Any]]:
    """Where MuJoCo has every body and site with joints of one axis anywhere in their range."""
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
    lower, upper = np.where(model.jnt_limited[:, None], model.jnt_range, [-_RANGE, _RANGE]).T
    for _ in range(_POSTURES):
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
