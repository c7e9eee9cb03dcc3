"""An arm by its name or from a file: ours (TOML), a URDF, or an MJCF."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from runtime.arms.description import (
    HAND_LIMITS,
    LIMITS,
    LINK_RADIUS,
    NOTHING,
    PAN_MASS,
    ArmDescription,
    Body,
    Frame,
    Hand,
    Joint,
    Vector,
    disc,
)
from runtime.arms.mjcf import read_mjcf
from runtime.arms.tree import chain
from runtime.arms.urdf import read_urdf
from runtime.documents.checks import column, fields, number, text
from runtime.documents.files import read_bytes, read_text, reading
from runtime.errors import InputError
from runtime.sizes import Sizes

SHIPPED = resources.files("runtime.arms") / "shipped"

MOUNT = Frame((0.0, 0.0, 0.22), (0.0, -1.5707963267948966, 0.0))
"""How a pan is held where nothing is said: by its handle, along the flange's z axis, as in the paper; the centre of the
pan is 0.22 m ahead of the flange."""

SUFFIXES = (".toml", ".urdf", ".xml", ".mjcf")

JOINT_KEYS = ("axis", "sliding", "lower", "upper", *LIMITS, "radius")
SOURCES = ("kinematics", "inertia", "range", *LIMITS, "hand", "home")


def arm_names() -> tuple[str, ...]:
    """The names of the arms that are shipped."""
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in SHIPPED.iterdir() if entry.name.endswith("toml")))


def load_arm(arm: str | Path, tip: str | None = None, mount: Frame | None = None) -> ArmDescription:
    """Return an arm's description.

    Args:
        arm: a name of `arm_names`, or a file: .toml (the form of the shipped ones), .urdf, .xml or .mjcf.
        tip: link of the file that is the flange; the end of its longest chain if None.
        mount: frame of the pan in the flange's; the file's own, or MOUNT, if None.

    Raises:
        InputError: no shipped arm of this name; the known ones are listed.
        FormatError: the file cannot be read, or is not what it seems to be; see `ArmDescription`, `chain`, `read_urdf`
            and `read_mjcf`.
        MissingExtraError: it is an MJCF, and mujoco is not installed.
    """
    path = Path(arm)
    if path.suffix.lower() not in SUFFIXES:
        names = arm_names()
        if str(arm) not in names:
            raise InputError(
                f"there is no arm named {str(arm)!r}: known are {', '.join(names)}, or give a file "
                f"({', '.join(SUFFIXES)})"
            )
        if tip is not None:
            raise InputError(f"--tip is of a URDF or an MJCF: the tip of {arm} is known")
        described = _described((SHIPPED / f"{arm}.toml").read_text(encoding="utf-8"), str(arm))
        return described if mount is None else _mounted(described, mount)
    with reading(str(path)):
        if path.suffix.lower() == ".toml":
            if tip is not None:
                raise InputError("--tip is of a URDF or an MJCF: a .toml tells its tip itself")
            described = _described(read_text(read_bytes(path)), path.stem)
            return described if mount is None else _mounted(described, mount)
        document = read_text(read_bytes(path))
        robot = read_mjcf(path) if "<mujoco" in document else read_urdf(document)
        joints, frame, end = chain(robot.links, tip)
        sources = dict.fromkeys(("kinematics", "inertia", "range", *LIMITS), path.name)
        mount = MOUNT if mount is None else mount
        pan = disc(PAN_MASS, Sizes().pan_radius)
        return ArmDescription(
            path.stem, f"{robot.name} ({path.name}, tip {end})", joints, frame, mount, pan, sources=sources
        )


def _mounted(described: ArmDescription, mount: Frame) -> ArmDescription:
    """Return the arm with its pan mounted another way, for which its home does not count."""
    values = {**vars(described), "mount": mount, "home": None}
    return ArmDescription(**values)


def _described(text_: str, name: str) -> ArmDescription:
    """Read a description in our own form; see docs/guide/arm."""
    try:
        document = tomllib.loads(text_)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {error}") from error
    keys = ("title", "sources", "tip", "mount", "joint")
    parts = fields(document, "", keys, ("home", "hand"))
    if not isinstance(parts["joint"], list):
        raise InputError("joint must be a list of tables, [[joint]]", "joint")
    sources = fields(parts["sources"], "sources", (), SOURCES)
    mount = fields(parts["mount"], "mount", ("position", "rpy"), ("mass",))
    mass = number(mount.get("mass", PAN_MASS), "mount.mass")
    hand = fields(parts.get("hand", {}), "hand", (), tuple(HAND_LIMITS))
    return ArmDescription(
        name=name,
        title=text(parts["title"], "title"),
        joints=tuple(_joint(each, f"joint[{index}]") for index, each in enumerate(parts["joint"])),
        tip=_frame(fields(parts["tip"], "tip", ("position", "rpy")), "tip"),
        mount=_frame(mount, "mount"),
        pan=disc(mass, Sizes().pan_radius) if mass else NOTHING,
        home=tuple(column(parts["home"], "home").tolist()) if "home" in parts else None,
        hand=Hand(**{key: number(value, f"hand.{key}") for key, value in hand.items()}),
        sources={key: text(value, f"sources.{key}") for key, value in sources.items()},
    )


def _joint(value: object, key: str) -> Joint:
    parts = fields(value, key, ("name", "position", "rpy", "mass", "centre", "inertia"), JOINT_KEYS)
    name = text(parts["name"], f"{key}.name")
    inertia = _numbers(parts, "inertia", 6, key)
    xx, yy, zz, xy, xz, yz = inertia
    body = Body(number(parts["mass"], f"{key}.mass"), _vector(parts, "centre", key), (xx, yy, zz, xy, xz, yz))
    optional = {each: number(parts[each], f"{key}.{each}") for each in ("lower", "upper", *LIMITS) if each in parts}
    sliding = parts.get("sliding", False)
    if not isinstance(sliding, bool):
        raise InputError(f"{key}.sliding must be true or false, got {sliding!r}", f"{key}.sliding")
    return Joint(
        name,
        _frame(parts, key),
        body,
        _vector(parts, "axis", key) if "axis" in parts else (0.0, 0.0, 1.0),
        sliding,
        radius=number(parts.get("radius", LINK_RADIUS), f"{key}.radius"),
        **optional,
    )


def _frame(parts: Mapping[str, Any], key: str) -> Frame:
    return Frame(_vector(parts, "position", key), _vector(parts, "rpy", key))


def _vector(parts: Mapping[str, Any], name: str, key: str) -> Vector:
    x, y, z = _numbers(parts, name, 3, key)
    return x, y, z


def _numbers(parts: Mapping[str, Any], name: str, count: int, key: str) -> list[float]:
    values: list[float] = column(parts[name], f"{key}.{name}").tolist()
    if len(values) != count:
        raise InputError(f"{key}.{name} must be {count} numbers, got {len(values)}", f"{key}.{name}")
    return values
