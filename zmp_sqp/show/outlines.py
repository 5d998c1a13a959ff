"""Outlines of a machine's links: points whose convex hulls are the shapes of its URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.urdf.elements import Shape, read_shape
from zmp_sqp.mechanics.urdf.meshes import MeshFolders
from zmp_sqp.mechanics.urdf.sources import package_folders
from zmp_sqp.mechanics.urdf.xacro_files import expanded

__all__ = ["hull", "link_shapes", "shape_points"]

ROUND = 24  # points around a cylinder or sphere
RINGS = 7  # rings of points between the poles of a sphere
FLAT = 1e-9  # [m] extent below which points have no area to fill


def link_shapes(urdf: Path, package_dirs: Sequence[str | Path] = ()) -> dict[str, list[Array]]:
    """Corner points of every shape, in the link's frame, shape (P, 3) [m], by name of the link.

    A link's visual shapes are taken, or its collision shapes if it has no visual ones that can be
    drawn. Meshes that cannot be read are left out.

    Args:
        urdf: A URDF that `load_machine` has accepted.
        package_dirs: Folders of packages, as for `load_machine`.

    Raises:
        MachineError: The file is in xacro and cannot be expanded, or a folder is not there.
    """
    folders = package_folders(list(package_dirs) or None)
    meshes, found = MeshFolders(urdf.parent, folders), {}
    for link in ET.fromstring(expanded(urdf.read_bytes(), urdf, folders)).findall("link"):
        for kind in ("visual", "collision"):
            shapes = list(_shapes(link, kind, meshes))
            if shapes:
                found[link.attrib["name"]] = shapes
                break
    return found


def shape_points(shape: Shape, meshes: MeshFolders) -> Array:
    """Points whose convex hull is that of a shape, link frame, (P, 3) [m].

    Round shapes are replaced by inscribed ones with `ROUND` corners.

    Args:
        shape: The shape.
        meshes: Finds and reads meshes.

    Raises:
        MachineError: A mesh cannot be read.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    if shape.kind == "box":
        local = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.dimensions
    elif shape.kind == "cylinder":
        radius, length = shape.dimensions
        local = np.vstack(
            [
                np.column_stack([radius * circle, np.full(ROUND, end)])
                for end in (-length / 2, length / 2)
            ]
        )
    elif shape.kind == "sphere":
        heights = np.cos(np.linspace(0.0, np.pi, RINGS))
        local = shape.dimensions[0] * np.vstack(
            [np.column_stack([np.sqrt(1.0 - z * z) * circle, np.full(ROUND, z)]) for z in heights]
        )
    else:
        local = meshes.hull(shape.filename, shape.scale)
    return np.asarray(local @ shape.rotation.T + shape.translation)


def hull(points: Array) -> Array:
    """Convex hull of points in the plane, (P, 2), counter-clockwise; a line keeps its two ends."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        along = points - points.mean(axis=0)
        if np.abs(along).max(initial=0.0) < FLAT:
            return points[:1]
        direction = np.linalg.svd(along, full_matrices=False)[2][0]
        order = np.argsort(along @ direction)
        return points[[order[0], order[-1]]]


def _shapes(link: ET.Element, kind: str, meshes: MeshFolders) -> Iterator[Array]:
    for element in link.findall(kind):
        try:
            yield shape_points(read_shape(element), meshes)
        except MachineError:  # no mesh, or a visual shape whose numbers are none: not drawn
            continue
