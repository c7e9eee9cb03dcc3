"""Plans the motion of a frying pan that makes the object on it slide along a given path.

from runtime import Planner
plan = Planner().plan(position)  # (K, 2) metres at 1 kHz
plan.save("plan.json")
"""

import runtime.interrupt  # noqa: F401 (Ctrl-C is answered by it, also while the rest is imported)
from runtime.command import Command
from runtime.commands.reading import Reading
from runtime.compilation import compile_law
from runtime.errors import (
    BundleError,
    ConcurrentUseError,
    FormatError,
    InputError,
    MissingExtraError,
    OutputError,
    ServerError,
    SlideError,
)
from runtime.friction import Friction
from runtime.limits import Limits
from runtime.plan import Plan
from runtime.planner import Planner
from runtime.quality import Quality, Status
from runtime.sizes import Sizes
from runtime.start import Start
from runtime.stream import FrictionEstimate, ObjectEstimate, Stream, StreamStatus
from runtime.version import __version__

__all__ = [
    "BundleError",
    "Command",
    "ConcurrentUseError",
    "FormatError",
    "Friction",
    "FrictionEstimate",
    "InputError",
    "Limits",
    "MissingExtraError",
    "ObjectEstimate",
    "OutputError",
    "Plan",
    "Planner",
    "Quality",
    "Reading",
    "ServerError",
    "Sizes",
    "SlideError",
    "Start",
    "Status",
    "Stream",
    "StreamStatus",
    "__version__",
    "compile_law",
]
