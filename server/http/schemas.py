"""What a client may ask, read strictly: nothing is converted, nothing unknown is passed over, no number is infinite.

The models check types, names and sizes while the JSON is parsed and stop at the first fault; what the numbers mean is
checked by `runtime`, in the same words as for files.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Annotated, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, FailFast, Field, ValidationError, model_validator

from runtime import Command, Friction, InputError, Limits, Reading, Sizes, Start
from runtime.client.messages import MOST_READINGS
from runtime.commands.bounds import MAX_SAMPLES
from runtime.errors import place_text, within
from runtime.physics.law import DT
from runtime.stream import OBJECT_NOISE
from server.planning.messages import GivenCommand, PlanJob, ReaderOptions, to_array
from server.problems import Problem

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Pair = tuple[Finite, Finite]
Told = float | None
"""A number that was measured; null, or no finite number, where it is missing."""

SeenRows = Annotated[list[tuple[Told, Told, Told, Told]], FailFast()]
PanRows = Annotated[list[Annotated[list[Told], Field(min_length=4, max_length=6)]], FailFast()]
Vector = Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3, description="[x, y] or [x, y, z]")]

Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """Reads what it is told and nothing else."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, hide_input_in_errors=True)


class CommandRequest(Strict):
    """Where the object is to be, relative to the pan (m), at even steps, at times, or along a path at a speed.

    Exactly one of `dt`, `t`, `rate` and `speed` says when.
    """

    dt: Positive | None = Field(None, description="Sampling interval (s); 0.001 is planned as it is.")
    t: Annotated[list[Finite], FailFast()] = Field([], min_length=2, description="Times (s), increasing.")
    rate: Positive | None = Field(None, description="Samples per second (Hz).")
    speed: Positive | None = Field(None, description="Highest speed along a path without times (m/s).")
    path_acceleration: Positive | None = Field(None, description="Highest acceleration along that path (m/s^2).")
    position: Annotated[list[Pair], FailFast()] = Field(min_length=2, description="[x, y] (m), one for each.")
    scale: Positive | None = Field(None, description="What positions are multiplied by to be metres.")
    time_scale: Positive | None = Field(None, description="What times are multiplied by to be seconds.")
    size: Positive | None = Field(None, description="How far the command goes from its start (m), in place of scale.")
    origin: Literal["pan", "first"] | Pair | None = Field(
        None, description="Where the pan's centre is: as it stands, at the first position, or at [x, y] (m)."
    )
    smooth: Positive | None = Field(None, description="Standard deviation of the smoothing over time (ms).")

    @model_validator(mode="after")
    def _timed(self) -> Self:
        given = [self.dt is not None, bool(self.t), self.rate is not None, self.speed is not None]
        if given.count(True) != 1:
            raise ValueError("exactly one of dt, t, rate and speed is needed")
        return self

    def samples(self) -> float:
        """Return how many samples at 1 kHz it will have, before it is resampled: a few bytes may ask for an hour."""
        if self.t:
            return (self.t[-1] - self.t[0]) * (self.time_scale or 1.0) / DT + 1
        if self.speed is not None:  # depends on the path; no more than ten minutes
            return 0.0
        return (len(self.position) - 1) * (self.dt or 1.0 / (self.rate or 1.0)) / DT + 1

    def given(self) -> GivenCommand:
        """Return the command as it was given.

        Raises:
            InputError: the options of reading contradict each other.
        """
        names = [each.name for each in fields(Reading)]
        reading = Reading(**self.model_dump(include=set(names), exclude_none=True))
        return GivenCommand(to_array(self.position), to_array(self.t) if self.t else None, self.dt, reading)


class FrictionRequest(Strict):
    """Coefficients of friction."""

    static: Positive
    kinetic: Positive


class LimitsRequest(Strict):
    """What the pan is to keep to; where nothing is said, the limits of the name, or the model's."""

    name: Literal["default", "panda", "fr3"] | None = Field(None, description="Of limits that are known.")
    pan_reach: Positive | None = Field(None, description="(m)")
    height: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = Field(
        None, description="Above and below the middle (m); 0 for a level pan."
    )
    speed: Positive | None = Field(None, description="(m/s); null for none.")
    acceleration: Positive | None = Field(None, description="(m/s^2)")
    jerk: Positive | None = Field(None, description="(m/s^3)")

    def limits(self, default: Limits) -> Limits:
        """Return these limits, with the default's where nothing is said.

        Raises:
            InputError: they contradict each other.
        """
        given = self.model_dump(exclude_none=True, exclude={"name"})
        if "speed" in self.model_fields_set and self.speed is None:
            given["speed"] = math.inf
        return replace(default if self.name is None else Limits.named(self.name), **given)


class StartRequest(Strict):
    """Where pan and object are, and how they move; at rest, the object on its mark, where nothing is said."""

    pan_position: Vector = (0.0, 0.0)
    pan_velocity: Vector = (0.0, 0.0)
    pan_acceleration: Vector = (0.0, 0.0)
    object_position: Pair | None = None
    object_velocity: Pair = (0.0, 0.0)


class Options(Strict):
    """What a command is planned with; the model's values where nothing is said."""

    friction: FrictionRequest | None = None
    limits: LimitsRequest | None = None
    start: StartRequest | None = None


class SizesRequest(Strict):
    """Radii of the pan and of the object on it."""

    pan_radius: Positive = Field(Sizes.pan_radius, description="(m)")
    object_radius: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(
        Sizes.object_radius, description="(m); 0 for a point."
    )


class PlanRequest(Options):
    """One command to be planned."""

    command: CommandRequest
    sizes: SizesRequest | None = None
    candidates: Annotated[int, Field(ge=1)] | None = Field(
        None,
        description="Plans to make, of the command turned and mirrored, and to keep the best of. If left out 1, and 8 "
        "where that is bad and the server has room.",
    )
    robust: Annotated[float, Field(ge=0.0, lt=1.0, allow_inf_nan=False)] | None = Field(
        None, description="Share by which the friction may be off, to judge candidates and refinement by."
    )
    refine_ms: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = Field(
        None, description="Time to spend on making the plan better (ms)."
    )
    tolerance: Positive | None = Field(None, description="Tracking RMSE to hold the plan against (m).")


class StreamRequest(Options):
    """What opens a stream."""

    format: Literal["slide-stream/1", "slide-stream/2"]
    command: CommandRequest
    packed: bool = False
    command_delay: float | None = Field(
        0.0, description="Time from a command to its execution (s); null to use what the encoders tell of it."
    )
    noise: float = Field(OBJECT_NOISE, description="Standard deviation of the positions of frames (m).")


MOST_NAMES, NAMES_OF_A_COMMAND = 2000, 16
"""Most names of a request, which a step with all its readings has three quarters of, and of a command among many."""


class FrameRequest(Strict):
    """Where a camera saw the object; see `Stream.see_object`."""

    position: tuple[Told, Told]
    age: Told = 0.0
    executed: int | None = None


class EncoderRequest(Strict):
    """Where the encoders say that the pan was; see `Stream.see_pan`."""

    state: Annotated[list[Told], Field(min_length=4, max_length=6)]
    age: Told = 0.0
    executed: int | None = None


class StepRequest(Strict):
    """A step as JSON: states (m, m/s), the last C of them or the last one; none where one is missing.

    The object's are [x, y, vx, vy], the pan's [x, y, z, vx, vy, vz], those of a level pan also [x, y, vx, vy]. In their
    place frames of a camera and readings of encoders may be told, with the time they were taken. `executed` samples of
    the last chunk have been executed, all of them if it is left out.
    """

    sequence: int = Field(ge=0)
    age: Told = 0.0
    pan: PanRows = Field([])
    object: SeenRows = Field([])
    frames: Annotated[list[FrameRequest], FailFast()] = Field([], max_length=MOST_READINGS)
    encoders: Annotated[list[EncoderRequest], FailFast()] = Field([], max_length=MOST_READINGS)
    executed: int | None = None
    command: CommandRequest | None = None
    start: StartRequest | None = None


class PlansRequest(Options):
    """Many commands to be planned, all with the same options."""

    commands: Annotated[list[CommandRequest], FailFast(), Field(min_length=1)]
    sizes: SizesRequest | None = None


def read(model: type[Model], body: bytes, most_names: int = MOST_NAMES) -> Model:
    """Parse and check a body.

    Args:
        model: what it must be.
        body: as it came.
        most_names: that it may have; each that is not known would be an error to be kept.

    Raises:
        Problem: `malformed` if it is not JSON, `invalid` if it is not what the model says; the place is named.
    """
    if body.count(b":") > most_names:
        raise Problem("invalid", f"there are more than {most_names} names")
    try:
        result = model.model_validate_json(body)
    except ValidationError as error:
        raise _problem(error) from None
    # No text that is taken as a value has a colon, so each of a document that was
    # read stands after a name.
    if body.count(b":") != _names(result):
        raise Problem("malformed", "a name is given twice")
    return result


def _names(model: BaseModel) -> int:
    count = len(model.model_fields_set)
    for name in model.model_fields_set:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            count += _names(value)
        elif isinstance(value, list) and value and isinstance(value[0], BaseModel):
            count += sum(map(_names, value))
    return count


def _problem(error: ValidationError) -> Problem:
    first = error.errors(include_url=False, include_context=True, include_input=False)[0]
    if first["type"] == "json_invalid":
        return Problem("malformed", first["msg"])
    place = first["loc"]
    if first["type"] == "extra_forbidden":  # the last part is a name the client made up
        return Problem("invalid", "there is a name that is not known here", place_text(place[:-1]))
    return Problem("invalid", first["msg"], place_text(place))


def to_command(request: CommandRequest, most: int, place: str) -> Command:
    """Return the command that was asked for at a place of the request.

    Raises:
        InputError: it is too long, or its numbers make no command; the place is named.
    """
    if len(request.position) > most:
        raise InputError(f"the command has {len(request.position)} positions, at most {most} are taken", place)
    samples = request.samples()
    if samples <= MAX_SAMPLES:  # beyond it the command itself asks for the unit of its times
        _check_samples(samples, most, place)
    with within(place):
        command = request.given().command()
    _check_samples(len(command), most, place)
    return command


def _check_samples(samples: float, most: int, place: str) -> None:
    if samples > most:
        raise InputError(f"the command has {samples:.0f} samples at 1 kHz, at most {most} are taken", place)


def to_job(options: Options, given: GivenCommand, bounds: ReaderOptions) -> PlanJob:
    """Return what is to be planned, with the manifest's values where nothing was said.

    Raises:
        InputError: a value cannot be planned with; the place is named.
    """
    friction, limits, start = bounds.manifest.friction, bounds.manifest.limits, Start()
    if options.friction is not None:
        with within("friction"):
            friction = Friction(options.friction.static, options.friction.kinetic)
    if options.limits is not None:
        with within("limits"):
            limits = options.limits.limits(limits)
    if options.start is not None:
        start = to_start(options.start)
    sizes = Sizes()
    if isinstance(options, (PlanRequest, PlansRequest)) and options.sizes is not None:
        with within("sizes"):
            sizes = Sizes(**options.sizes.model_dump())
    job = PlanJob(given, friction, limits, start, sizes)
    if not isinstance(options, PlanRequest):
        return job
    if options.refine_ms is not None and options.refine_ms > bounds.max_refine_ms:
        raise InputError(f"at most {bounds.max_refine_ms:g} ms are spent", "refine_ms")
    if options.candidates is not None and options.candidates > bounds.max_candidates:
        raise InputError(f"at most {bounds.max_candidates} candidates are made", "candidates")
    return job._replace(
        tolerance=options.tolerance,
        candidates=options.candidates,
        robust=options.robust,
        refine_ms=options.refine_ms or None,
    )


def to_start(request: StartRequest) -> Start:
    """Return a start.

    Raises:
        InputError: a value is beyond all reason; the place is named.
    """
    with within("start"):
        return Start(**request.model_dump())
