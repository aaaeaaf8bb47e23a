"""Measured BRDFs in .csbrdf files: open, decode, evaluate.

    import csbrdf
    brdf = csbrdf.open("chrome.csbrdf")
    table = brdf.decode()                    # float32 [channel, theta_h, theta_d, phi_d], 1/sr
    rgb = brdf.eval([0.3, 0, 0.9], wo)       # wo: (..., 3); gives float32 (..., 3), 1/sr, without the cosine
    draw = brdf.importance()
    wo, pdf = draw.sample([0.3, 0, 0.9], u)  # u: (..., 2) in [0, 1); wo about in proportion to brdf times cosine

Directions point away from the surface, z along its normal, x along its tangent. Angles are in radians: half and
difference angles (Rusinkiewicz 1998) for MERL-style tables. The environment variable RAYON_NUM_THREADS, read at first
use, sets the number of threads.
"""

import enum

from ._csbrdf import Axis, Brdf, Channel, Error, Importance, __version__, open

__all__ = ["Axis", "Brdf", "Channel", "Error", "Importance", "Origin", "open"]


class Origin(enum.IntEnum):
    """Where an entry of a decoded table comes from."""

    SAMPLED = 0
    """Measured, and a sample of the recovery."""
    MEASURED = 1
    """Measured, but not sampled: the recovery had to predict it."""
    FILLED = 2
    """Not measured; filled in by the recovery."""
    IMPOSSIBLE = 3
    """Not measured, and no pair of directions above the horizon falls into the bin."""
