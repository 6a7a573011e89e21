"""Connects a driving policy to DreamStream: subclass `Policy`, answer `plan`, and `run` it.

Frames: rig (x forward, y left, origin on the ground under the rear axle), camera (x right, y down, z forward).
SI units, radians, seconds. Images are numpy arrays of 8-bit RGB, rows top to bottom.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bridge import run
    from .policy import Camera, Command, Ego, Observation, Plan, PlanError, Policy, Session

__all__ = ["Camera", "Command", "Ego", "Observation", "Plan", "PlanError", "Policy", "Session", "run"]


def __getattr__(name: str) -> Any:
    """Imports what is asked for when it is: `dreamstream.simulator` needs neither arrays nor the bus."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import bridge, policy

    return getattr(bridge if name == "run" else policy, name)
