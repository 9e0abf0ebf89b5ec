"""The digest of a body: its URDF and the meshes that it names, so that an edit is noticed."""

from __future__ import annotations

import hashlib
from pathlib import Path
from xml.etree import ElementTree as Xml

from pipeline.errors import ScenarioError
from pipeline.physics.bullet import find_body

SCHEMES = ("file://", "package://", "model://")


def body_digest(body: str) -> str | None:
    """Return the SHA-256 of a body's files; None where it cannot be found or read as a URDF."""
    try:
        urdf = find_body(body)
        digest = hashlib.sha256(urdf.read_bytes())
        meshes = {mesh.get("filename", "") for mesh in Xml.parse(urdf).iter("mesh")}
        for name in sorted(meshes):
            mesh = _found(name, urdf)
            digest.update(b"no mesh" if mesh is None else _sha256(mesh))
    except (ScenarioError, OSError, ValueError, LookupError, Xml.ParseError):
        return None  # its runs say what is wrong with it
    return digest.hexdigest()


def _found(name: str, urdf: Path) -> Path | None:
    """Return the file of a mesh: here, beside the URDF, or in a folder above that.

    Source: Bullet 3.25, `examples/Importers/ImportURDFDemo/UrdfFindMeshFile.h`.
    """
    for scheme in SCHEMES:
        name = name.removeprefix(scheme)
    for folder in (Path(), *urdf.parents):
        if name and (folder / name).is_file():
            return folder / name
    return None


def _sha256(path: Path) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
