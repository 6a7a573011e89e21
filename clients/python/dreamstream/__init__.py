"""Connects a driving policy to DreamStream: subclass `Policy`, answer `plan`, and `run` it.

Frames: rig (x forward, y left, origin on the ground under the rear axle), camera (x right, y down, z forward).
SI units, radians, seconds. Images are numpy arrays of 8-bit RGB, rows top to bottom.
"""

from .policy import Camera, Command, Ego, Observation, Plan, PlanError, Policy, Session
from .bridge import run

__all__ = ["Camera", "Command", "Ego", "Observation", "Plan", "PlanError", "Policy", "Session", "run"]
