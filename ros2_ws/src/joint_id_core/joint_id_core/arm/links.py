"""Links of an arm that exist, are near those of the description, and have the base parameters of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.consistent import ACCURACY, OF_MASS, Problem
from joint_id_core.arm.pseudo_inertia import about_centre, nearest_body, of_body, parameters_of, pseudo_inertia
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array

SAME = 1e-6  # entropic distance of a body that did not move: about 0.1 %
CONTRADICTED = 4.0  # standard deviations of a base parameter from that of bodies: of forty, by chance once in 400 fits
IMPOSSIBLE = 8.0  # the same, from which something is wrong that no interval contains; of a UR10e it is 2 to 3
UNLIKE = 2.0  # share by which a description is wrong that says nothing of single links: it is 0.4 of masses


@dataclass(frozen=True)
class Body:
    """Mass in kg, centre of mass in m, and xx, xy, yy, xz, yz, zz of the inertia about it in kg m^2."""

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]

    @classmethod
    def of(cls, pseudo: Array) -> Body:
        """Return the body of a pseudo-inertia (4, 4)."""
        mass, centre, inertia = about_centre(pseudo)
        x, y, z = centre.tolist()
        (xx, xy, xz), (_, yy, yz), (*_, zz) = inertia.tolist()
        return cls(mass, (x, y, z), (xx, xy, yy, xz, yz, zz))

    @property
    def pseudo_inertia(self) -> Array:
        """The pseudo-inertia, shape (4, 4)."""
        xx, xy, yy, xz, yz, zz = self.inertia
        return of_body(self.mass, np.array(self.centre), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


@dataclass(frozen=True)
class Link:
    """What a joint moves, with all that is fixed to it, in the frame of the joint.

    Attributes:
        name: of the link that the joint moves; `joint`: of the joint.
        described, found: by the description, and by the fit; the same if the fit says nothing of it.
        rotor: inertia of the rotor seen at the link in kg m^2 (kg for a prismatic joint); 0 if it is not known.
    """

    name: str
    joint: str
    described: Body
    found: Body
    rotor: float

    @property
    def moved(self) -> float:
        """How far the centre of mass is from that of the description, in m."""
        return float(np.linalg.norm(np.subtract(self.found.centre, self.described.centre)))


@dataclass(frozen=True)
class Links:
    """All links.

    Attributes:
        links: in the order of the joints.
        share: by which second moments of the description seem to be wrong; masses by a fifth of it.
        off, farthest: base parameters of the links from those of the fit, in standard deviations, rms and at most.
        doubts: bodies of the description that do not exist, and base parameters that no bodies have.
        contradiction: the latter, if they are so far that the torques cannot be right; else empty.
    """

    links: tuple[Link, ...]
    share: float
    off: float
    farthest: float
    doubts: tuple[str, ...]
    contradiction: str

    @property
    def lines(self) -> list[str]:
        """Masses and centres before and after, as lines of a table."""
        width = max(len("link"), *(len(link.name) for link in self.links)) + 2
        lines = [f"  {'link':<{width}}{'mass, kg':<22}{'centre moved, mm':<18}beside it a rotor, kg m^2"]
        for link in self.links:
            masses, moved = f"{link.described.mass:.4g} -> {link.found.mass:.4g}", f"{1e3 * link.moved:.3g}"
            body = f"{'as described':<40}" if link.found == link.described else f"{masses:<22}{moved:<18}"
            lines.append(f"  {link.name:<{width}}{body}" + (f"{link.rotor:.4g}" if link.rotor else "-"))
        wrong, mass = 100.0 * self.share, 100.0 * self.share / np.sqrt(OF_MASS)
        told = f"masses of the description seem to be wrong by {mass:.3g} %, and how they are spread by {wrong:.3g} %"
        return [
            *lines,
            f"  bodies nearest to the description with the combinations that were found, {self.off:.2g} standard "
            f"deviations off (rms; at most {self.farthest:.2g})",
            f"  {told}",
        ]


def consistent_links(regressor: Regressor, values: Array, covariance: Array, rotors: Sequence[float]) -> Links:
    """Return the links.

    Args:
        regressor: of the arm.
        values, covariance: of its base parameters, shapes (B,) and (B, B); those of variance 0 were not seen.
        rotors: inertia of the rotor of each joint by the fit, where it is known, else 0.
    """
    described = [pseudo_inertia(body) for body in regressor.bodies]
    near = np.array([nearest_body(body) for body in described])
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    seen = np.flatnonzero(sigma > 0.0)
    known = np.array(rotors, dtype=float)
    place = np.ix_(seen, seen)
    found = Problem(regressor.composition[seen], values[seen], covariance[place], known, near).solved()
    same = [
        distance < SAME and np.linalg.eigvalsh(before).min() > 0.0
        for distance, before in zip(found.distances, described, strict=True)
    ]
    bodies = [before if kept else after for kept, before, after in zip(same, described, found.bodies, strict=True)]
    made = regressor.composition @ np.concatenate([found.rotors, *map(parameters_of, bodies)])
    doubts = [
        f"link {name} of the description has an inertia that no body has: it starts from the nearest one"
        for name, before in zip(regressor.links, described, strict=True)
        if np.linalg.eigvalsh(before).min() <= 0.0
    ]
    contradiction = ""
    away = np.abs(made - values)[seen] / np.hypot(sigma, ACCURACY * values)[seen]
    if (count := int(np.count_nonzero(away > CONTRADICTED))) > 0:
        k = int(seen[np.argmax(away)])
        doubts.append(
            f"{count} combinations of masses and inertias are such as no bodies have; farthest is "
            f"{regressor.combinations[k]} = {values[k]:.3g} ± {sigma[k]:.2g}, bodies have {made[k]:.3g}: another load "
            "acts, friction follows another law, or a torque constant is wrong"
        )
        if np.max(away) > IMPOSSIBLE:
            contradiction = f"{doubts[-1]}; or the axis of a joint points the other way, or joints are exchanged"
    if found.share > UNLIKE:
        doubts.append(
            "the bodies of the description are far from those found: their torques are right, but the mass of a single "
            "link is hardly known"
        )
    rows = zip(regressor.links, regressor.joints, described, bodies, found.rotors, strict=True)
    links = tuple(Link(n, j, Body.of(before), Body.of(after), float(r)) for n, j, before, after, r in rows)
    off, farthest = float(np.sqrt(np.mean(away**2))), float(np.max(away))
    return Links(links, found.share, off, farthest, tuple(doubts), contradiction)
