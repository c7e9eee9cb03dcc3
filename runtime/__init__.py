"""Plans the motion of a frying pan that makes the object on it slide along a given path.

from runtime import Planner
plan = Planner().plan(position)  # (K, 2) metres at 1 kHz
plan.save("plan.json")
"""

from runtime.command import Command
from runtime.errors import BundleError, FormatError, InputError, MissingExtraError, OutputError, SlideError
from runtime.friction import Friction
from runtime.plan import Plan, Quality, Status
from runtime.planner import Planner

__all__ = [
    "BundleError",
    "Command",
    "FormatError",
    "Friction",
    "InputError",
    "MissingExtraError",
    "OutputError",
    "Plan",
    "Planner",
    "Quality",
    "SlideError",
    "Status",
]
