"""Cleaning of URDF files, which keeps links, joints and primitive shapes and repairs or removes what engines cannot read."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import ModelError
from equipoise.robot.cleaning.urdf_joints import clean_joints
from equipoise.robot.cleaning.urdf_text import number, tidy_vector

# An inertial lighter than this fraction of the robot is a placeholder (1e-6 kg base links, 1e-5 kg camera frames): it
# has no measurable effect and fails engines' inertia checks.
NEGLIGIBLE_MASS_FRACTION = 1e-6
# The base of a robot has 0.37 to 0.70 of its mass in the catalogue. A lighter link above one moving joint is a virtual one.
LIGHTEST_BASE = 0.05


def clean_urdf(root: ET.Element, path: Path, base_link: str | None) -> Iterator[str]:
    """Clean a URDF in place; yields a sentence for each change that concerns the user."""
    links = {link.get("name", ""): link for link in root.findall("link")}
    if not links:
        raise ModelError(f"robot model {str(path)!r} has no <link>")
    for tag in ("transmission", "gazebo", "material", "sensor"):
        for element in root.findall(tag):
            root.remove(element)
    yield from _strip_geometry(links)
    yield from _repair_inertials(links, path)
    yield from _prune_to_base(root, links, path, base_link)
    yield from clean_joints(root, path)


def _strip_geometry(links: dict[str, ET.Element]) -> Iterator[str]:
    """Remove visuals and mesh collisions. Primitive collisions stay: spheres mark the feet."""
    meshes = 0
    for link in links.values():
        for visual in link.findall("visual"):
            link.remove(visual)
        for collision in link.findall("collision"):
            if collision.find("geometry/mesh") is not None or collision.find("geometry") is None:
                link.remove(collision)
                meshes += 1
    if meshes:
        yield f"{meshes} collision meshes are ignored: the feet are modelled as spheres and nothing else touches the floor"


def _repair_inertials(links: dict[str, ET.Element], path: Path) -> Iterator[str]:
    masses = {name: _link_mass(link, path) for name, link in links.items()}
    total = sum(masses.values())
    if total <= 0:
        raise ModelError(f"robot model {str(path)!r} has no mass: no link has an <inertial> with a positive mass")
    negligible: list[str] = []
    for name, link in links.items():
        inertial = link.find("inertial")
        if inertial is None:
            continue
        if masses[name] <= NEGLIGIBLE_MASS_FRACTION * total:
            link.remove(inertial)
            negligible.append(name)
            continue
        element = inertial.find("inertia")
        if element is None:
            raise ModelError(f"robot model {str(path)!r}: link {name!r} has a mass and no <inertia>")
        # If urdfdom cannot read one number of an <inertial>, it silently drops all of it, the mass too.
        for key in _INERTIA_KEYS:
            element.attrib.setdefault(key, "0")
        for key in ("xyz", "rpy"):
            tidy_vector(inertial.find("origin"), key, f"link {name!r}: {key} of its <inertial>", path)
        inertia = read_inertia(element, name, path)
        repaired = physical_inertia(inertia, masses[name])
        if np.array_equal(repaired, inertia):
            continue
        if not _is_physical_but_for_rounding(inertia):
            principal = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(inertia))
            yield (
                f"link {name!r} has an inertia that no body can have (principal moments {principal} kg m2); "
                "it was moved to the nearest physical one"
            )
        write_inertia(element, repaired)
    if negligible:
        shown = ", ".join(negligible[:4]) + (", ..." if len(negligible) > 4 else "")
        yield f"{len(negligible)} links with (almost) no mass are treated as massless: {shown}"


_INERTIA_KEYS = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def read_inertia(element: ET.Element, link: str, path: Path) -> NDArray[np.float64]:
    """Return the (3, 3) tensor of an <inertia> [kg m2]; missing components are zero."""
    inertia = np.zeros((3, 3))
    for key, (row, column) in _INERTIA_KEYS.items():
        value = number(element.get(key), 0.0, f"link {link!r}: {key}", path)
        inertia[row, column] = inertia[column, row] = value
    return inertia


def write_inertia(element: ET.Element, inertia: NDArray[np.float64]) -> None:
    """Write a (3, 3) tensor into an <inertia> [kg m2]."""
    for key, (row, column) in _INERTIA_KEYS.items():
        element.set(key, repr(float(inertia[row, column])))


def physical_inertia(inertia: NDArray[np.float64], mass: float, least: float = 1e-6) -> NDArray[np.float64]:
    """Return the nearest physical inertia tensor [kg m2] of a rigid body of that mass, in the principal frame.

    A body's second moments of mass S = tr(I)/2 - I are not negative, which is the triangle inequality of the principal
    moments. Negative ones are raised to a millimetre's radius of gyration, or, if they are negative only by the file's
    rounding, by as little as engines without tolerance need.

    Args:
        inertia: (3, 3) inertia about the centre of mass [kg m2].
        mass: mass [kg].
        least: smallest second moment after the repair, over the largest.
    """
    values, vectors = np.linalg.eigh(_second_moments(inertia))
    if values.min() >= 1e-9 * values.max() and values.max() > 0:
        return inertia
    floor = max(least * values.max(), 0.0 if _is_physical_but_for_rounding(inertia) else 1e-6 * mass)
    lifted = (vectors * np.maximum(values, floor)) @ vectors.T
    return np.trace(lifted) * np.eye(3) - lifted


def _second_moments(inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.trace(inertia) / 2 * np.eye(3) - inertia


def _is_physical_but_for_rounding(inertia: NDArray[np.float64]) -> bool:
    """Return whether it violates the triangle inequality by no more than a plate with rounded moments."""
    values = np.linalg.eigvalsh(_second_moments(inertia))
    return bool(values.min() >= -1e-3 * abs(values.max()) and np.linalg.eigvalsh(inertia).min() > 0)


def _prune_to_base(root: ET.Element, links: dict[str, ET.Element], path: Path, base_link: str | None) -> Iterator[str]:
    """Remove links above the base: `world`, an `odom`, the links of a chain of joints that models a floating base."""
    joints = root.findall("joint")
    ends, top = _tree(joints, links, path)
    if base_link is not None and base_link not in links:
        raise ModelError(f"robot model {str(path)!r} has no link {base_link!r}; it has {', '.join(sorted(links))}")
    masses, dropped = {name: _link_mass(link, path) for name, link in links.items()}, list[str]()
    while top != base_link:
        below = [joint for joint in joints if ends[id(joint)][0] == top]
        moves = len(below) == 1 and below[0].get("type") not in ("fixed", "floating")
        light = masses[top] <= (LIGHTEST_BASE if moves else 0.0) * sum(masses.values())
        if len(below) != 1 or not light:
            if base_link is not None:
                raise ModelError(
                    f"base link {base_link!r} is below {top!r}, which has mass or more than one joint: "
                    f"{top!r} is the base"
                )
            break
        root.remove(below[0])
        root.remove(links[top])
        dropped.append(top)
        top = ends[id(below[0])][1]
    if dropped:
        yield f"links above the base {top!r} are ignored: {', '.join(dropped)}"


def _tree(joints: list[ET.Element], links: dict[str, ET.Element], path: Path) -> tuple[dict[int, tuple[str, str]], str]:
    """Return parent and child link of each joint, by its `id`, and the root link; raises ModelError if not one tree."""
    ends: dict[int, tuple[str, str]] = {}
    joint_above: dict[str, str] = {}
    for joint in joints:
        parent, child = joint.find("parent"), joint.find("child")
        name = joint.get("name", "")
        if parent is None or child is None:
            raise ModelError(f"robot model {str(path)!r}: joint {name!r} lacks a <parent> or a <child>")
        above, below = ends[id(joint)] = parent.get("link", ""), child.get("link", "")
        for end in (above, below):
            if end not in links:
                raise ModelError(f"robot model {str(path)!r}: joint {name!r} names a link {end!r} that does not exist")
        if below in joint_above:
            raise ModelError(
                f"robot model {str(path)!r}: link {below!r} is the child of two joints, {joint_above[below]!r} and {name!r}; "
                "a robot is one tree"
            )
        joint_above[below] = name
    roots = [name for name in links if name not in joint_above]
    if len(roots) != 1:
        raise ModelError(
            f"robot model {str(path)!r} has {len(roots)} root links ({', '.join(roots[:5])}); a robot is one tree"
        )
    reached = roots.copy()
    for link in reached:  # grows as it goes
        reached += [below for above, below in ends.values() if above == link]
    if len(reached) < len(links):
        loop = [name for name in links if name not in reached]
        raise ModelError(f"robot model {str(path)!r}: links {', '.join(loop[:5])} form a loop; a robot is one tree")
    return ends, roots[0]


def _link_mass(link: ET.Element, path: Path) -> float:
    element = link.find("inertial/mass")
    if element is None:
        return 0.0
    mass = number(element.get("value"), 0.0, f"link {link.get('name')!r}: mass", path)
    if mass < 0:
        raise ModelError(f"robot model {str(path)!r}: link {link.get('name')!r} has a negative mass, {mass} kg")
    return mass
