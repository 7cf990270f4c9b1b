"""Masses, centres of mass and inertias of a URDF, changed to those of a fit.

A joint moves a link and all that is fixed to it, and a fit knows them together. Every part is changed by the same map
of the pseudo-inertia, P -> A P A', so that their sum is the body that was found, and each of them is a body again.

A URDF has no place for the inertia of a rotor. That of the first joint goes into the link that it turns, as a ring
about its axis: such a link turns about nothing else, so its motion is the same. That of any other joint would also load
the joints before it, which it does not do as a rotor, and is left out.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from joint_id_core.arm.links import Body, Link, Links
from joint_id_core.arm.pseudo_inertia import nearest_body
from joint_id_core.arm.urdf import TURNING, end_of
from joint_id_core.data.recording import Array
from joint_id_core.results.robot_files import as_text

DIGITS = ".12g"
INERTIA = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")


def with_bodies(text: str, links: Links, source: str) -> str:
    """Return a URDF in which links have other bodies; what else it holds stays.

    Args:
        text: the URDF of the description.
        links: what was found; those that are as in the description are left.
        source: of the bodies, for a comment in each link.
    """
    root = ET.fromstring(text, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    for link in links.links:
        ring = _ring(root, link)
        if link.found != link.described or ring.any():
            _change(root, link, ring, source)
    return as_text(root, text)


def _ring(root: ET.Element, link: Link) -> Array:
    """Return the second moments (3, 3) of a ring with the inertia of a first joint's rotor; zero for other joints."""
    joints = {end_of(joint, "child"): joint for joint in root.findall("joint")}
    joint = joints[link.name]
    above = joints.get(end_of(joint, "parent"))
    while above is not None and above.get("type") == "fixed":
        above = joints.get(end_of(above, "parent"))
    if above is not None or joint.get("type") not in TURNING:
        return np.zeros((3, 3))
    given = joint.find("axis")
    axis = np.array(("1 0 0" if given is None else given.get("xyz", "1 0 0")).split(), dtype=float)
    axis /= np.linalg.norm(axis)
    return np.asarray(0.5 * link.rotor * (np.eye(3) - np.outer(axis, axis)))


def _change(root: ET.Element, link: Link, ring: Array, source: str) -> None:
    """Change a link and what is fixed to it; the second moments of a ring are added to it."""
    parts = [(e, place, place @ _body(e).pseudo_inertia @ place.T) for e, place in _fixed(root, link.name)]
    start = nearest_body(link.described.pseudo_inertia)
    together = " with what is fixed to it" if len(parts) > 1 else ""
    heaviest = int(np.argmax([part[3, 3] for *_, part in parts]))
    parts[heaviest][2][:] += start - sum(part for *_, part in parts)
    end = link.found.pseudo_inertia
    end[:3, :3] += ring
    change = _map(start, end)
    rotor = f", and the rotor of {link.joint}: {link.rotor:.5g} kg m^2" if ring.any() else ""
    for element, place, part in parts:
        back = np.linalg.inv(place)
        changed = Body.of(back @ change @ part @ change.T @ back.T)
        told = f" {source}: {link.described.mass:.5g} -> {link.found.mass:.5g} kg{together}{rotor} "
        _write(element, changed, re.sub("-(?=-)", "- ", told))


def _map(start: Array, end: Array) -> Array:
    """Return A (4, 4) with A start A' = end, which is the identity where both are the same."""
    root = np.linalg.cholesky(start)
    back = np.linalg.inv(root)
    sizes, axes = np.linalg.eigh(back @ end @ back.T)
    return np.asarray(root @ (axes * np.sqrt(sizes)) @ axes.T @ back)


def _fixed(root: ET.Element, name: str) -> Iterator[tuple[ET.Element, Array]]:
    """Yield inertial elements of a link and of those that are fixed to it, with the way to the frame of the link."""
    waiting = [(name, np.eye(4))]
    while waiting:
        name, place = waiting.pop()
        links = [link for link in root.findall("link") if link.get("name") == name]
        for element in (inertial for link in links for inertial in link.findall("inertial")):
            mass = element.find("mass")
            if mass is not None and float(mass.get("value", "0")) > 0.0:
                yield element, place @ _origin(element)
        for joint in root.findall("joint[@type='fixed']"):
            parent, child = joint.find("parent"), joint.find("child")
            if parent is not None and child is not None and parent.get("link") == name:
                waiting.append((child.get("link", ""), place @ _origin(joint)))


def _origin(element: ET.Element) -> Array:
    """Return the way (4, 4) from the frame of an origin to the one that it stands in."""
    origin = element.find("origin")
    texts = {} if origin is None else origin.attrib
    place = np.eye(4)
    place[:3, 3] = np.array(texts.get("xyz", "0 0 0").split(), dtype=float)
    roll, pitch, yaw = np.array(texts.get("rpy", "0 0 0").split(), dtype=float)
    for k, angle in ((2, yaw), (1, pitch), (0, roll)):
        turn, (i, j) = np.eye(3), ((1, 2), (2, 0), (0, 1))[k]
        turn[[i, j], [i, j]] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        place[:3, :3] = place[:3, :3] @ turn
    return place


def _body(element: ET.Element) -> Body:
    """Return the body of an inertial element, in the frame of its origin."""
    mass, inertia = element.find("mass"), element.find("inertia")
    values = [0.0 if inertia is None else float(inertia.get(name, "0")) for name in INERTIA]
    xx, xy, yy, xz, yz, zz = values
    return Body(0.0 if mass is None else float(mass.get("value", "0")), (0.0, 0.0, 0.0), (xx, xy, yy, xz, yz, zz))


def _write(element: ET.Element, body: Body, told: str) -> None:
    """Write a body, given in the frame of the origin, into an inertial element; the frame keeps its directions."""
    for name in ("origin", "mass", "inertia"):
        if element.find(name) is None:
            ET.SubElement(element, name)
    place = _origin(element) @ np.array([*body.centre, 1.0])
    for part in element:
        if part.tag == "origin":
            part.set("xyz", " ".join(format(c, DIGITS) for c in place[:3].tolist()))
        elif part.tag == "mass":
            part.set("value", format(body.mass, DIGITS))
        elif part.tag == "inertia":
            part.attrib.update({n: format(v, DIGITS) for n, v in zip(INERTIA, body.inertia, strict=True)})
    element.insert(0, ET.Comment(told))
    element[0].tail = element.text
