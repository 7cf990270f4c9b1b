"""The ten inertial parameters of a rigid body as one matrix, which is positive definite for bodies and no others.

The pseudo-inertia is the integral of [x; 1][x; 1]' over the mass of the body, 4 by 4: second moments, first moments and
mass (Wensing, Kim & Slotine, IEEE Robotics and Automation Letters 3, 2018). It says at once that the mass is positive
and that no principal inertia is larger than the sum of the two others. In a frame that T (4, 4) leads to, it is T P T'.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array

SMALLEST = 0.01  # m, radius of gyration of a body in any direction: less is a point or a plate, which no link is


def pseudo_inertia(parameters: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of mass, first moments, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin (10,)."""
    mass, *moments = parameters[:4].tolist()
    xx, xy, yy, xz, yz, zz = parameters[4:].tolist()
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    found = np.empty((4, 4))
    found[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    found[:3, 3] = found[3, :3] = moments
    found[3, 3] = mass
    return found


def parameters_of(pseudo: Array) -> Array:
    """Return mass, first moments, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin (10,) of a pseudo-inertia (4, 4)."""
    second = pseudo[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    below = [inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *below])


def about_centre(pseudo: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass (3,), and inertia about it (3, 3)."""
    mass = float(pseudo[3, 3])
    centre = pseudo[:3, 3] / mass
    second = pseudo[:3, :3] - mass * np.outer(centre, centre)
    return mass, centre, np.trace(second) * np.eye(3) - second


def of_body(mass: float, centre: Array, inertia: Array) -> Array:
    """Return the pseudo-inertia (4, 4) from mass, centre of mass (3,) and inertia about it (3, 3)."""
    found = np.empty((4, 4))
    found[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(centre, centre)
    found[:3, 3] = found[3, :3] = mass * centre
    found[3, 3] = mass
    return found


def nearest_body(pseudo: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of a body of the same mass, which must be above 0, and the same centre.

    It is that which was given, if no direction of it is thinner than a link can be.
    """
    mass, centre = float(pseudo[3, 3]), pseudo[:3, 3] / pseudo[3, 3]
    own = mass * np.outer(centre, centre)
    size, axes = np.linalg.eigh(pseudo[:3, :3] - own)
    if size.min() >= mass * SMALLEST**2:
        return pseudo
    found = pseudo.copy()
    found[:3, :3] = axes @ np.diag(np.maximum(size, mass * SMALLEST**2)) @ axes.T + own
    return found
