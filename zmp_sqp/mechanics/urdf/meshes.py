"""Finds and reads the meshes that stand for the shape of a link, within allowed folders only."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import MachineError

__all__ = ["MeshFolders"]

FORMATS = (".stl", ".obj", ".dae")
LARGEST = 200 << 20  # [bytes] more is no mesh of a link
SCHEMES = ("package://", "model://")


class MeshFolders:
    """Folders in which meshes may lie: that of the URDF, and those that the user allows."""

    def __init__(self, urdf_folder: Path, package_dirs: Sequence[Path]) -> None:
        """Remember the folders.

        Args:
            urdf_folder: Folder of the URDF, to which relative paths in it refer.
            package_dirs: Folders that hold packages, or are packages themselves.
        """
        self._urdf_folder = urdf_folder.resolve()
        self._package_dirs = [folder.resolve() for folder in package_dirs]

    def hull(self, filename: str, scale: tuple[float, ...]) -> Array:
        """Corners of the convex hull of a mesh, in its own axes, shape (P, 3) [m].

        Args:
            filename: File as the URDF names it.
            scale: Factors of x, y and z.

        Raises:
            MachineError: The file is not there, lies outside the folders, or is no mesh; the
                message names it.
        """
        points = _mesh(*self._content(filename))[0] * scale
        if not len(points) or not np.isfinite(points).all():
            raise MachineError(f"mesh {filename!r} has no vertices, or some that are not finite")
        return _corners(points)

    def triangles(self, filename: str, scale: tuple[float, ...]) -> tuple[Array, Indices]:
        """Surface of a mesh, in its own axes.

        Args:
            filename: File as the URDF names it.
            scale: Factors of x, y and z.

        Returns:
            Vertices, shape (P, 3) [m], and the vertices of each triangle, shape (F, 3).

        Raises:
            MachineError: As for `hull`.
        """
        points, faces = _mesh(*self._content(filename))
        points = points * scale
        if not len(faces) or not np.isfinite(points).all():
            raise MachineError(f"mesh {filename!r} has no surface, or a vertex that is not finite")
        return points, faces

    def _content(self, filename: str) -> tuple[bytes, Path]:
        """Content of a mesh file, and its path."""
        if not filename:
            raise MachineError("a shape is none of box, cylinder, sphere and mesh with a filename")
        path = self._locate(filename)
        if path.suffix.lower() not in FORMATS:
            raise MachineError(f"mesh {filename!r} is none of {', '.join(FORMATS)}")
        try:
            size = path.stat().st_size
            content = path.read_bytes() if size <= LARGEST else b""
        except OSError as cause:
            raise MachineError(f"mesh {path} cannot be read: {cause.strerror or cause}") from None
        if not content:
            raise MachineError(f"mesh {path} is {'empty' if not size else 'larger than 200 MB'}")
        return content, path

    def _locate(self, filename: str) -> Path:
        """Path of a mesh, with symbolic links resolved; it exists and lies in a folder."""
        scheme = next((known for known in SCHEMES if filename.startswith(known)), None)
        if scheme is not None:
            package, _, rest = unquote(filename.removeprefix(scheme)).partition("/")
            candidates = [folder / package / rest for folder in self._package_dirs]
            candidates += [folder / rest for folder in self._package_dirs if folder.name == package]
            hint = f"give the folder that holds {package!r} in package_dirs"
        else:
            name = unquote(filename).removeprefix("file://")
            candidates = [self._urdf_folder / name]  # an absolute path replaces the folder
            hint = "meshes may lie in the URDF's folder and in package_dirs"
        try:
            found = [place for place in candidates if place.is_file()]
            places = [place.resolve() for place in found]
        except (OSError, ValueError, RuntimeError) as cause:
            raise MachineError(f"mesh {filename!r} is no path that can be read: {cause}") from None
        if not places:
            raise MachineError(f"mesh {filename!r} is not there; {hint}")
        allowed = [self._urdf_folder, *self._package_dirs]
        for place in places:
            if any(place.is_relative_to(folder) for folder in allowed):
                return place
        raise MachineError(
            f"mesh {filename!r} lies outside the URDF's folder and package_dirs, at {places[0]}; "
            "add its folder to package_dirs if it may be opened"
        )


def _mesh(content: bytes, path: Path) -> tuple[Array, Indices]:
    """Vertices of a mesh file, shape (P, 3), and those of each triangle, shape (F, 3).

    The library reads a copy in an empty folder, without references to materials, so that the file
    cannot make it open others.
    """
    try:
        import coal  # slow to import, and only needed here
    except ImportError as cause:  # it comes with pin, but a system's Pinocchio may lack it
        raise MachineError(f"mesh {path} cannot be read without coal: {cause}") from None
    suffix, unit = path.suffix.lower(), 1.0
    if suffix == ".obj":
        lines = content.splitlines(keepends=True)
        content = b"".join(line for line in lines if not line.lstrip().startswith(b"mtllib"))
    elif suffix == ".dae" and b"<!" in content.replace(b"<!--", b""):
        raise MachineError(f"mesh {path} has DOCTYPE or ENTITY declarations, which are refused")
    elif suffix == ".dae":
        unit = _collada_unit(content)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"mesh{suffix}"
        copy.write_bytes(content)
        try:
            found = coal.MeshLoader().load(str(copy))
            points = unit * np.array(found.vertices(), dtype=np.float64)
            corners = (found.tri_indices(i) for i in range(found.num_tris))
            faces = [(corner[0], corner[1], corner[2]) for corner in corners]
        except (ValueError, RuntimeError, TypeError, MemoryError) as cause:
            said = " ".join(str(cause).replace(str(copy), path.name).split())
            raise MachineError(f"mesh {path} cannot be read: {said}") from None
    return points, np.array(faces, dtype=np.intp).reshape(-1, 3)


def _collada_unit(content: bytes) -> float:
    """Unit of length of a COLLADA file [m], which its reader leaves to us; as RViz applies it."""
    found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)", content)
    try:
        return 1.0 if found is None else float(found[1])
    except ValueError:
        return float("nan")


def _corners(points: Array) -> Array:
    """Corners of the convex hull of points; all distinct points where they are flat."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and only needed here

    points = np.unique(points, axis=0)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points
