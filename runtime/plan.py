"""A plan: how the pan is to move so that the object slides along the command, and what to expect of it.

Time line: row k of every array belongs to t_k = k dt, k = 0..K-1; row k of the pan acceleration acts from t_k to
t_(k+1), so that the last one leads out of the command. The stop follows: row j of its acceleration acts from t_(K+j) to
t_(K+j+1), and after it the pan is at rest. A plan's JSON document is the planner's file, the server's
answer and the input of every replay, all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from runtime.assess.assess import assess
from runtime.documents.checks import FloatArray, check_format, fields, number, table, text
from runtime.documents.files import parse_json, parse_npz, read_bytes, read_text, reading
from runtime.documents.writing import write_whole
from runtime.errors import InputError
from runtime.friction import Friction
from runtime.limits import NO_LIMITS
from runtime.outputs.csv_file import to_csv
from runtime.outputs.formats import FORMATS, format_of
from runtime.outputs.frame import to_dataframe
from runtime.outputs.json_file import listed
from runtime.outputs.notebook import summary, to_html
from runtime.outputs.npz_file import from_npz, to_npz
from runtime.outputs.plot import plot
from runtime.physics.law import DT, slide_one
from runtime.physics.motion import Motion, in_space, lengths, tracking_error
from runtime.physics.pan import integrate_pan
from runtime.quality import Quality, Status
from runtime.safety.pan import Pan, state_after
from runtime.safety.rest import stop_after
from runtime.safety.stop import RESTING
from runtime.sizes import Sizes

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

__all__ = ["PLAN_FORMAT", "Plan", "Quality", "Status", "tracking_error"]

PLAN_FORMAT = "slide-plan/2"

LEVEL_FORMAT = "slide-plan/1"
"""What older versions wrote: the pan is in its plane, and its rows are [x, y]."""

OPTIONAL = ("sizes", "stop")
"""Keys that plans written by older versions lack."""

DEFAULT_SIZES = Sizes()


@dataclass(frozen=True, eq=False)
class Plan:
    """The pan's motion for one command, and the object's motion it predicts.

    Attributes:
        dt: sampling interval (s).
        model_name: name of the bundle that made the plan.
        model_sha256: sha256 of that bundle's manifest, which carries the hashes of its graphs.
        friction: the coefficients the plan was made for.
        command_position: (K, 2) where the object should be, relative to the pan (m).
        pan_acceleration: (K, 3) in the world (m/s^2), the third upwards, 0 for a level pan; row k acts from t_k to
            t_(k+1).
        pan_velocity: (K, 3) in the world (m/s).
        pan_position: (K, 3) in the world, relative to where the pan began (m).
        object_velocity: (K, 2) predicted, relative to the pan (m/s).
        object_position: (K, 2) predicted, relative to the pan (m).
        quality: figures, limits and status.
        sizes: radii of the pan and of the object.
        stop_acceleration: (n, 3) in the world (m/s^2), what follows the last row of `pan_acceleration`: the pan comes
            to rest within its limits, and where that is possible, the object stays on its mark. Empty in plans that
            were written before plans had a stop.
    """

    dt: float
    model_name: str
    model_sha256: str
    friction: Friction
    command_position: FloatArray
    pan_acceleration: FloatArray
    pan_velocity: FloatArray
    pan_position: FloatArray
    object_velocity: FloatArray
    object_position: FloatArray
    quality: Quality
    sizes: Sizes = DEFAULT_SIZES
    stop_acceleration: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(
        cls,
        motion: Motion,
        stop: FloatArray,
        command_position: FloatArray,
        friction: Friction,
        quality: Quality,
        model_name: str,
        model_sha256: str = "",
        sizes: Sizes = DEFAULT_SIZES,
    ) -> Self:
        """Return the plan of a motion of K samples at 1 kHz, in arrays of its own; for the others see the class."""
        pan, sliding = motion.pan[:-1], motion.sliding[:-1]
        return cls(
            dt=DT,
            model_name=model_name,
            model_sha256=model_sha256,
            friction=friction,
            command_position=command_position.copy(),
            pan_acceleration=motion.acceleration.copy(),
            pan_velocity=pan[:, 3:].copy(),
            pan_position=pan[:, :3].copy(),
            object_velocity=sliding[:, 2:].copy(),
            object_position=sliding[:, :2].copy(),
            quality=quality,
            sizes=sizes,
            stop_acceleration=stop.copy(),
        )

    @classmethod
    def of_accelerations(
        cls, u: FloatArray, friction: Friction, name: str, command_position: FloatArray | None = None
    ) -> Self:
        """Return a plan that no network made: of given pan accelerations, within no limits, from rest.

        Args:
            u: (K, 3) pan accelerations (m/s^2), or (K, 2) of a level pan.
            friction: coefficients that the object's motion is predicted with.
            name: what stands in the place of the model's name.
            command_position: (K, 2) where the object should be (m), and where it begins; what is predicted from the
                pan's centre if None.
        """
        u = in_space(u)
        start = np.zeros((1, 4))
        if command_position is not None:
            start[0, :2] = command_position[0]
        pan = np.concatenate([np.zeros((1, 6)), integrate_pan(np.zeros(6), u)])
        motion = Motion(u, u, pan, np.concatenate([start, slide_one(start[0], u, friction)]))
        command = motion.sliding[:-1, :2] if command_position is None else command_position
        stop = stop_after(motion, len(u), Pan(state_after(pan, u), RESTING, NO_LIMITS), command[-1], friction)
        quality = assess(motion, stop, command, friction, NO_LIMITS, DEFAULT_SIZES, u[0])
        return cls.of(motion, stop, command, friction, quality, name)

    def __len__(self) -> int:
        """Return the number of samples, K."""
        return len(self.command_position)

    def replay(self, friction: Friction | None = None) -> FloatArray:
        """Slide the object again along the plan's pan accelerations, maybe under another friction (Eqs. 4 and 9).

        Args:
            friction: coefficients; the plan's own if None, which gives the plan's prediction again, bit for bit.

        Returns:
            (K, 4) object position (m) and velocity (m/s) relative to the pan at t_0..t_(K-1).
        """
        start = np.concatenate([self.object_position[0], self.object_velocity[0]])
        # The last acceleration leads out of the time line: nothing of it is seen.
        after = slide_one(start, self.pan_acceleration[:-1], friction or self.friction, self.dt)
        return np.concatenate([start[None], after])

    def with_stop(self, friction: Friction | None = None) -> Motion:
        """Return the plan's K samples and the n of its stop as one motion, maybe under another friction.

        The states of t_0 to t_(K-1) are the plan's own, to the last bit; those after it follow by the double integrator
        and by the law. Under another friction the object is slid again from the start, as `replay` does.
        """
        u = np.concatenate([self.pan_acceleration, self.stop_acceleration])
        pan = np.concatenate([self.pan_position, self.pan_velocity], axis=1)
        sliding, after = self.replay(friction), u[len(self) - 1 :]
        return Motion(
            u,
            u,
            np.concatenate([pan, integrate_pan(pan[-1], after, self.dt)]),
            np.concatenate([sliding, slide_one(sliding[-1], after, friction or self.friction, self.dt)]),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document; every float keeps all its digits."""
        return listed(self.document())

    def document(self) -> dict[str, Any]:
        """Return the JSON document with the arrays as they are, for writers that know arrays."""
        return {
            "format": PLAN_FORMAT,
            "dt": self.dt,
            "model": {"name": self.model_name, "sha256": self.model_sha256},
            "friction": self.friction.to_dict(),
            "command": {"position": self.command_position},
            "pan": {
                "acceleration": self.pan_acceleration,
                "velocity": self.pan_velocity,
                "position": self.pan_position,
            },
            "stop": {"acceleration": self.stop_acceleration},
            "object": {"velocity": self.object_velocity, "position": self.object_position},
            "sizes": self.sizes.to_dict(),
            "quality": self.quality.to_dict(),
        }

    def to_npz(self) -> bytes:
        """Return the document as the bytes of an npz file: arrays with dotted names."""
        return to_npz(self.document())

    def to_csv(self, path: str | PathLike[str] | None = None) -> str:
        """Return the plan as a table in CSV: a row for each sample, then those of the stop; see the formats' reference.

        Args:
            path: file to write it to as well, whatever its suffix.

        Raises:
            OutputError: the file cannot be written.
        """
        data = to_csv(self.document())
        if path is not None:
            write_whole(Path(path), data)
        return data.decode("ascii")

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the same table as a DataFrame of pandas, whose index is the time (s).

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return to_dataframe(self.document())

    def plot(self) -> Figure:
        """Draw where object and pan go, and how fast, within which limits; gives matplotlib's figure.

        Raises:
            MissingExtraError: matplotlib is not installed.
        """
        return plot(self.document())

    def __repr__(self) -> str:
        """Return one line: how long, how good, of which model."""
        return f"<{summary(self.document())}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the picture and the figures."""
        return to_html(self.document())

    @classmethod
    def from_dict(cls, document: object, source: str = "plan") -> Self:
        """Read the JSON document; older ones lack the keys of OPTIONAL, or are of LEVEL_FORMAT.

        Args:
            document: the parsed document.
            source: where it came from, for the message.

        Raises:
            FormatError: another format version, a key missing or unknown, a wrong shape, a value that is no finite
                number; the message names the key.
        """
        with reading(source):
            level = isinstance(document, Mapping) and document.get("format") == LEVEL_FORMAT
            check_format(document, LEVEL_FORMAT if level else PLAN_FORMAT)
            needed = ("format", "dt", "model", "friction", "command", "pan", "object", "quality")
            parts = fields(document, "", needed, OPTIONAL)
            model = fields(parts["model"], "model", ("name", "sha256"))
            command = fields(parts["command"], "command", ("position",))
            pan = fields(parts["pan"], "pan", ("acceleration", "velocity", "position"))
            sliding = fields(parts["object"], "object", ("velocity", "position"))
            stop = fields(parts["stop"], "stop", ("acceleration",))["acceleration"] if "stop" in parts else []
            dt = number(parts["dt"], "dt")
            if dt <= 0.0:
                raise InputError(f"dt must be greater than 0 s, got {dt:g}")
            position = table(command["position"], "command.position")
            if not len(position):
                raise InputError("command.position must have at least one row")

            def space(value: object, key: str) -> FloatArray:
                return in_space(table(value, key)) if level else table(value, key, 3)

            def rows(value: object, key: str, read: Callable[[object, str], FloatArray] = table) -> FloatArray:
                result = read(value, key)
                if len(result) != len(position):
                    raise InputError(f"{key} has {len(result)} rows, command.position has {len(position)}")
                return result

            velocity = rows(pan["velocity"], "pan.velocity", space)
            quality = _with_space(parts["quality"], velocity) if level else parts["quality"]
            return cls(
                dt=dt,
                model_name=text(model["name"], "model.name"),
                model_sha256=text(model["sha256"], "model.sha256"),
                friction=Friction.from_dict(parts["friction"]),
                command_position=position,
                pan_acceleration=rows(pan["acceleration"], "pan.acceleration", space),
                pan_velocity=velocity,
                pan_position=rows(pan["position"], "pan.position", space),
                object_velocity=rows(sliding["velocity"], "object.velocity"),
                object_position=rows(sliding["position"], "object.position"),
                quality=Quality.from_dict(quality),
                stop_acceleration=space(stop, "stop.acceleration"),
                sizes=Sizes.from_dict(parts["sizes"]) if "sizes" in parts else DEFAULT_SIZES,
            )

    def save(self, path: str | PathLike[str]) -> None:
        """Write the plan as `.json`, `.npz`, `.csv` or `.parquet`, by the suffix; the file appears whole or not at all.

        `load` reads the first two. A pipe or a device without a suffix gets JSON; see `write_whole`.

        Raises:
            OutputError: another suffix, or the file cannot be written.
            MissingExtraError: Parquet without pyarrow.
        """
        path = Path(path)
        write_whole(path, FORMATS[format_of(path)](self.document()))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a plan from `.json` or `.npz`, by the suffix.

        Raises:
            FormatError: the file cannot be read, or is no plan of this format version; see `from_dict`.
        """
        path = Path(path)
        with reading(str(path)):
            if path.suffix.lower() == ".json":
                document = parse_json(read_text(read_bytes(path)))
            elif path.suffix.lower() == ".npz":
                document = from_npz(parse_npz(read_bytes(path)))
            elif path.suffix.lower() in FORMATS:
                raise InputError(
                    f"a plan is read from .json or .npz; a {path.suffix} file holds its numbers for other programs. "
                    "Is this a command? Then make a plan of it with slide-plan"
                )
            else:
                raise InputError(f"a plan is a .json or .npz file, got the suffix {path.suffix!r}")
        return cls.from_dict(document, str(path))


def _with_space(quality: object, velocity: FloatArray) -> object:
    """Return the figures of a plan of LEVEL_FORMAT with those it lacks: of a level pan, without a limit on its speed.

    Its velocity is (K, 3) (m/s). What is no figures at all is left to `Quality` to refuse.
    """
    if not isinstance(quality, Mapping):
        return quality
    found = {"height_max": 0.0, "speed_max": float(lengths(velocity).max()), **quality}
    for name in ("limits", "margins", "worst"):
        part = quality.get(name)
        if isinstance(part, Mapping):
            level = None if name == "worst" or part.get("pan_reach") is None else 0.0
            found[name] = {"height": level, "speed": None, "jerk": None, **part}
    return found
