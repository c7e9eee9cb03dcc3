"""What an arm is: a chain of joints from its base to its tip, its limits, and how it holds the pan.

Lengths in m, angles in rad, masses in kg, inertias in kg m^2. The world is the arm's base. A number that nobody
publishes is None: it is said to be unknown, and not checked.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields

import numpy as np

from runtime.documents.checks import FloatArray, number
from runtime.errors import InputError

Vector = tuple[float, float, float]

LIMITS = {"speed": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "N m"}
"""The limits of a joint beside its range, and their units; for a joint that slides see SLIDING_LIMITS."""

SLIDING_LIMITS = {"speed": "m/s", "acceleration": "m/s^2", "jerk": "m/s^3", "torque": "N"}
"""The same for a joint that slides."""

HAND_LIMITS = {"speed": "m/s", "acceleration": "m/s^2", "jerk": "m/s^3"}
"""The limits of the hand, and their units."""

LINK_RADIUS = 0.05
"""Radius with which a link is drawn where none is given (m)."""

PAN_MASS = 0.8
"""Mass of the pan with its handle where none is given (kg)."""

FARTHEST = 10.0
"""Largest coordinate of a frame or a centre of mass (m): beyond it is millimetres."""

MOST_TURN = 12.6
"""Largest angle of a frame's attitude (rad), two turns: beyond it is degrees."""

HEAVIEST = 1e4
"""Largest mass of a link (kg): beyond it is grams."""

MOST_JOINTS = 30
"""Joints that are read: an arm of more is none."""

FEWEST_JOINTS = 6
"""Joints that a pan needs to go anywhere and stay level (three places, three angles)."""


@dataclass(frozen=True)
class Frame:
    """Where a frame is in the one before it.

    Attributes:
        position: of its origin (m).
        rpy: its attitude: roll, pitch and yaw about the fixed axes x, y and z, in this order, as in a URDF (rad).
    """

    position: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) from this frame into the one before."""
        (sr, sp, sy), (cr, cp, cy) = np.sin(self.rpy), np.cos(self.rpy)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The attitude as w, x, y, z."""
        (sr, sp, sy), (cr, cp, cy) = np.sin(np.array(self.rpy) / 2), np.cos(np.array(self.rpy) / 2)
        w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
        y, z = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
        return float(w), float(x), float(y), float(z)

    @classmethod
    def of(cls, position: FloatArray, rotation: FloatArray) -> Frame:
        """Return the frame of a position (3,) (m) and a rotation (3, 3)."""
        pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
        if abs(rotation[2, 0]) < 1.0 - 1e-12:  # else roll and yaw are one angle
            roll, yaw = math.atan2(rotation[2, 1], rotation[2, 2]), math.atan2(rotation[1, 0], rotation[0, 0])
        else:
            roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
        return cls(_vector(position), (roll, pitch, yaw))


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes:
        mass: (kg).
        centre: its centre of mass in its link's frame (m).
        inertia: xx, yy, zz, xy, xz, yz about the centre of mass, along the axes of its link's frame (kg m^2).
    """

    mass: float
    centre: Vector
    inertia: tuple[float, float, float, float, float, float]

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) the inertia as a matrix."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @classmethod
    def of(cls, mass: float, centre: FloatArray, matrix: FloatArray) -> Body:
        """Return the body of a centre (3,) and an inertia matrix (3, 3) about it."""
        xx, yy, zz = (float(matrix[i, i]) for i in range(3))
        return cls(mass, _vector(centre), (xx, yy, zz, float(matrix[0, 1]), float(matrix[0, 2]), float(matrix[1, 2])))

    def moved(self, frame: Frame) -> Body:
        """Return the same body told in the frame that `frame` stands in."""
        rotation = frame.rotation
        centre = np.array(frame.position) + rotation @ np.array(self.centre)
        return Body.of(self.mass, centre, rotation @ self.matrix @ rotation.T)

    def __add__(self, other: Body) -> Body:
        """Return the two as one, both told in one frame."""
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        centre = (self.mass * np.array(self.centre) + other.mass * np.array(other.centre)) / mass
        matrix = np.zeros((3, 3))
        for each in (self, other):
            d = np.array(each.centre) - centre
            matrix += each.matrix + each.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return Body.of(mass, centre, matrix)


NOTHING = Body(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
"""A body without mass."""


@dataclass(frozen=True)
class Joint:
    """A joint and the link it moves.

    Attributes:
        name: of the joint.
        frame: of the joint at angle zero, in the frame of the link before it; the link's own frame turns with it.
        body: the link's mass and inertia.
        axis: unit vector in its frame.
        sliding: whether it slides along the axis rather than turn about it; its limits are then in m and N.
        lower, upper: its range (rad); None if it turns without end.
        speed, acceleration, jerk, torque: its limits; None if unknown.
        radius: of its link, to draw it (m).
    """

    name: str
    frame: Frame
    body: Body
    axis: Vector = (0.0, 0.0, 1.0)
    sliding: bool = False
    lower: float | None = None
    upper: float | None = None
    speed: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    torque: float | None = None
    radius: float = LINK_RADIUS

    @property
    def units(self) -> Mapping[str, str]:
        """The unit of each of its limits."""
        return SLIDING_LIMITS if self.sliding else LIMITS


@dataclass(frozen=True)
class Hand:
    """What is published of the hand as a whole; None if it is unknown.

    Attributes:
        speed: largest speed of the tip (m/s).
        acceleration: its largest acceleration (m/s^2).
        jerk: its largest jerk (m/s^3).
    """

    speed: float | None = None
    acceleration: float | None = None
    jerk: float | None = None


@dataclass(frozen=True)
class ArmDescription:
    """An arm that holds a pan.

    Attributes:
        name: in small letters, as it is given on a command line.
        title: as its maker calls it.
        joints: from the base to the tip.
        tip: frame of the flange, in that of the last link.
        mount: frame of the pan in that of the tip: the origin is the pan's centre, z its normal, x points from the
            handle to the pan.
        pan: the pan with its handle, told in the pan's frame; NOTHING if the last link holds it already.
        home: joint angles (rad) with the pan where it begins; None if they are to be found.
        hand: limits of the hand.
        sources: where each kind of number comes from: kinematics, inertia, range, and the names of LIMITS; hand, home.

    Raises:
        InputError: fewer than six joints or more than MOST_JOINTS, two of one name, a value that is no finite number,
            or so large that it must be in another unit, a limit that is not greater than zero, a range that is empty,
            a mass or inertia that no body has.
    """

    name: str
    title: str
    joints: tuple[Joint, ...]
    tip: Frame
    mount: Frame
    pan: Body
    home: tuple[float, ...] | None = None
    hand: Hand = Hand()
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.joints) < FEWEST_JOINTS:
            joints = "1 joint" if len(self.joints) == 1 else f"{len(self.joints)} joints"
            raise InputError(
                f"arm {self.name} has {joints} between its base and its tip, at least {FEWEST_JOINTS} are needed to "
                "move a pan and keep it level"
            )
        if len(self.joints) > MOST_JOINTS:
            raise InputError(
                f"arm {self.name} has {len(self.joints)} joints between its base and its tip, at most {MOST_JOINTS} "
                "are read: another tip (--tip)?"
            )
        names = self.joint_names
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"arm {self.name} has two joints named {name}")
        for joint in self.joints:
            _check_joint(joint)
        _check_frame(self.tip, "the tip")
        _check_frame(self.mount, "the pan's mount")
        _check_body(self.pan, "the pan")
        for name in HAND_LIMITS:
            _check_limit(getattr(self.hand, name), f"limit {name} of the hand", HAND_LIMITS[name])
        if self.home is not None and len(self.home) != len(self.joints):
            raise InputError(f"arm {self.name}: home has {len(self.home)} angles for {len(self.joints)} joints")

    def __len__(self) -> int:
        """Return the number of joints, n."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, from the base to the tip."""
        return tuple(joint.name for joint in self.joints)

    def limit(self, name: str) -> FloatArray:
        """Return (n,) the joints' limits of one of LIMITS, infinite where it is unknown."""
        return np.array([math.inf if (value := getattr(joint, name)) is None else value for joint in self.joints])

    @property
    def range(self) -> tuple[FloatArray, FloatArray]:
        """(n,) lower and upper ends of the joints' ranges (rad), infinite where there is none."""
        lower = np.array([-math.inf if joint.lower is None else joint.lower for joint in self.joints])
        upper = np.array([math.inf if joint.upper is None else joint.upper for joint in self.joints])
        return lower, upper

    @property
    def unknown(self) -> tuple[str, ...]:
        """Those of LIMITS that are known for none of the joints."""
        return tuple(name for name in LIMITS if all(getattr(joint, name) is None for joint in self.joints))

    @property
    def digest(self) -> str:
        """A short text that changes with any number of the description."""
        text = json.dumps(asdict(self), sort_keys=True, default=dict)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def disc(mass: float, radius: float) -> Body:
    """Return a flat disc about its centre, normal z: what a pan is like. Mass in kg, radius in m."""
    across = 0.25 * mass * radius**2
    return Body(mass, (0.0, 0.0, 0.0), (across, across, 2.0 * across, 0.0, 0.0, 0.0))


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _check_joint(joint: Joint) -> None:
    place = f"joint {joint.name}"
    for value in _numbers(joint):
        number(value, place)
    _check_frame(joint.frame, place)
    if not math.isclose(math.hypot(*joint.axis), 1.0, rel_tol=1e-6):
        raise InputError(f"{place}: its axis must be one long, got {list(joint.axis)}")
    if joint.lower is not None and joint.upper is not None and not joint.lower < joint.upper:
        raise InputError(f"{place}: its range is empty: from {joint.lower:g} to {joint.upper:g}")
    for name, unit in joint.units.items():
        _check_limit(getattr(joint, name), f"limit {name} of {place}", unit)
    _check_body(joint.body, f"the link of {place}")
    if joint.body.mass <= 0.0:
        raise InputError(f"the link of {place} has no inertia: its mass must be greater than 0 kg")


def _check_frame(frame: Frame, name: str) -> None:
    for value in (*frame.position, *frame.rpy):
        number(value, name)
    _check_near(frame.position, f"the frame of {name}")
    turn = max(map(abs, frame.rpy))
    if turn > MOST_TURN:
        raise InputError(f"the frame of {name} is turned by {turn:g} rad, more than two turns: is it in degrees?")


def _check_near(position: Vector, name: str) -> None:
    farthest = max(map(abs, position))
    if farthest > FARTHEST:
        raise InputError(f"{name} is {farthest:g} m away, more than {FARTHEST:g} m: is it in millimetres?")


def _numbers(joint: Joint) -> Iterator[float]:
    """Yield the numbers of a joint, but those of its frame and its body."""
    yield from joint.axis
    for each in fields(joint):
        value = getattr(joint, each.name)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield value


def _check_limit(value: float | None, name: str, unit: str) -> None:
    if value is not None and not number(value, name) > 0.0:
        raise InputError(f"{name} must be greater than 0 {unit}, got {value:g}; leave it out if it is unknown")


def _check_body(body: Body, name: str) -> None:
    for value in (body.mass, *body.centre, *body.inertia):
        number(value, name)
    if body.mass < 0.0:
        raise InputError(f"{name} has a mass of {body.mass:g} kg, which is less than 0")
    if body.mass > HEAVIEST:
        raise InputError(f"{name} has a mass of {body.mass:g} kg, more than {HEAVIEST:g} kg: is it in grams?")
    _check_near(body.centre, f"the centre of mass of {name}")
    largest = max(map(abs, body.inertia))
    if largest > HEAVIEST * FARTHEST**2:
        raise InputError(f"{name} has an inertia of {largest:g} kg m^2: is it in kg mm^2?")
    least = float(np.linalg.eigvalsh(body.matrix)[0])
    if least < -1e-9 * max(1.0, abs(float(np.trace(body.matrix)))):
        raise InputError(f"{name} has an inertia that no body has: its least principal moment is {least:g} kg m^2")
