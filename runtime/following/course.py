"""What a stream follows: its command, and after that the moves that bring the object back to its end."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, Self

from runtime.command import Command
from runtime.commands.come_back import come_back
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.network.bundle import Bundle
from runtime.network.job import Job
from runtime.network.reader import Reader
from runtime.observe.estimates import FrictionEstimate

NOTICED_DELAY = 2
"""Samples by which an arm must be later than was thought for the command to be read anew."""

NOTICED_FRICTION = 0.05
"""Share by which the friction found must differ from what the network was told, for it to be told anew."""


class Course(NamedTuple):
    """A value, which its methods do not change.

    Attributes:
        bundle: the network.
        job: what was asked for; its command is the one that is given, its friction what the network is told.
        advance: samples by which the command is told in advance, to an arm that executes late.
        ahead: the command as it is told.
        followed: the same, or the move that brings the object back.
        reader: what reads it.
    """

    bundle: Bundle
    job: Job
    advance: int
    ahead: Command
    followed: Command
    reader: Reader

    @classmethod
    def begin(cls, bundle: Bundle, job: Job, advance: int) -> Self:
        """Return the course from the beginning of a job's command."""
        ahead = _in_advance(job.command, advance)
        return cls(bundle, job, advance, ahead, ahead, Reader.at(bundle, [job._replace(command=ahead)]))

    @property
    def mark(self) -> FloatArray:
        """(2,) where the object should be once the command is over (m)."""
        mark: FloatArray = self.job.command.position[-1]
        return mark

    @property
    def over(self) -> bool:
        """Whether the next chunk begins past the end of the command, or of the move that brings the object back."""
        return self.reader.now >= len(self.followed)

    @property
    def past(self) -> int:
        """Samples since the end of the command."""
        return self.reader.now - len(self.ahead)

    def retargeted(self, command: Command) -> Self:
        """Follow another command from its beginning."""
        return self.begin(self.bundle, self.job._replace(command=command), self.advance)

    def advanced(self, late: int) -> Self:
        """Read the command farther in advance, if the arm turned out to be that late (samples)."""
        if abs(late - self.advance) < NOTICED_DELAY or self.over:
            return self
        ahead = _in_advance(self.job.command, late)
        course = self._replace(advance=late, ahead=ahead)
        return course._reading(ahead, self.reader.now) if self.followed is self.ahead else course

    def told(self, found: FrictionEstimate) -> Self:
        """Tell the network the friction that the frames say, once they rule out what it was told."""
        if self.over:
            return self
        told = self.job.friction
        static = _believed(told.static, found.friction.static, found.static)
        kinetic = _believed(told.kinetic, found.friction.kinetic, found.kinetic)
        if (static, kinetic) == (told.static, told.kinetic):
            return self
        job = self.job._replace(friction=Friction(max(static, kinetic), kinetic))
        return self._replace(job=job, reader=self.reader.told([job._replace(command=self.followed)]))

    def bringing_back(self, place: FloatArray, friction: Friction) -> Self:
        """Bring an object at a place (2,) to the end of the command (m)."""
        return self._reading(Command(come_back(place, self.mark, friction)))

    def again(self) -> tuple[Self, FloatArray]:
        """Return what is left of the command, read anew, and (2,) where the object should be now (m)."""
        now = self.reader.now if self.followed is self.ahead else len(self.ahead)
        return self._reading(self.ahead, now), self.ahead.position[min(now, len(self.ahead) - 1)]

    def _reading(self, followed: Command, now: int = 0) -> Self:
        reader = Reader.at(self.bundle, [self.job._replace(command=followed)], now)
        return self._replace(followed=followed, reader=reader)


def _in_advance(command: Command, late: int) -> Command:
    """Return a command as it must be told to an arm that executes late, by so many samples."""
    return replace(command, position=command.position[late:]) if 0 < late < len(command) - 1 else command


def _believed(told: float, found: float, interval: tuple[float, float]) -> float:
    """Return a coefficient as it was told, or as it was found if what was told is ruled out."""
    ruled_out = not interval[0] <= told <= interval[1]
    return found if ruled_out and abs(found - told) > NOTICED_FRICTION * told else told
