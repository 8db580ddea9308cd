"""The files of a bundle beside the targets' own: manifest, provenance, licences, notice."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from assetbuild._version import __version__
from assetbuild.engine.digest import digest_file, regular_bytes
from assetbuild.errors import UsageError
from assetbuild.recipe.models import Recipe

_MEDIA_TYPES = {
    ".xml": "application/xml",
    ".urdf": "application/xml",
    ".obj": "model/obj",
    ".png": "image/png",
    ".json": "application/json",
    ".html": "text/html",
    ".md": "text/markdown",
    ".yaml": "application/yaml",
    ".py": "text/x-python",
    ".usda": "model/vnd.usda",
    ".usdc": "model/vnd.usd",
    ".usd": "model/vnd.usd",
}


@dataclass(frozen=True)
class BundleFile:
    """One file of the bundle: by its digest in the store, or by its bytes."""

    path: str
    role: str
    sha256: str
    size: int
    content: bytes | None = None

    @classmethod
    def of_bytes(cls, path: str, role: str, content: bytes) -> BundleFile:
        """A file that the report wrote."""
        return cls(path, role, hashlib.sha256(content).hexdigest(), len(content), content)

    @classmethod
    def of_text(cls, path: str, role: str, text: str) -> BundleFile:
        """A text file, UTF-8."""
        return cls.of_bytes(path, role, text.encode("utf-8"))


def json_text(value: object) -> str:
    """JSON as people read it: keys sorted, two spaces; what is not finite as `"inf"`, `"nan"`."""
    plain = _finite(value)
    return json.dumps(plain, indent=2, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _finite(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(held) for held in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def manifest(robot: str, files: Iterable[BundleFile]) -> BundleFile:
    """`manifest.json`: everything but itself and `provenance.json`."""
    rows = [
        {
            "path": file.path,
            "sha256": file.sha256,
            "size": file.size,
            "media_type": media_type(file.path),
            "role": file.role,
        }
        for file in sorted(files, key=lambda file: file.path)
    ]
    content = {"schema": "assetbuild-bundle/v1", "robot": robot, "files": rows}
    return BundleFile.of_text("manifest.json", "manifest", json_text(content))


def files_of(bundle: Path, *, bytecode: bool = False) -> Iterator[tuple[str, Path]]:
    """Yield (relative path, path) of each file and link of a folder.

    bytecode: also what Python writes when a module of the bundle is imported.
    """
    for path in bundle.rglob("*"):
        is_listed = bytecode or path.parent.name != "__pycache__"
        if is_listed and (path.is_symlink() or not path.is_dir()):
            yield path.relative_to(bundle).as_posix(), path


def differing_files(
    bundle: Path,
    wanted: Mapping[str, str],
    digest: Callable[[Path], str] = digest_file,
    *,
    bytecode: bool = False,
) -> Iterator[tuple[str, str]]:
    """Yield ("missing", "added" or "changed", path) of files that are not as `wanted`.

    wanted: path -> SHA-256; a link in place of a file is a change. bytecode: see `files_of`.
    """
    held = dict(files_of(bundle, bytecode=bytecode))
    for name in sorted(wanted.keys() | held.keys()):
        path = held.get(name)
        if path is None:
            yield "missing", name
        elif name not in wanted:
            yield "added", name
        elif path.is_symlink() or not path.is_file() or digest(path) != wanted[name]:
            yield "changed", name


def manifest_of(bundle: Path) -> dict[str, str]:
    """Path -> SHA-256 as the manifest says. UsageError when it is no bundle."""
    return _listed(bundle, "sha256")


def roles_of(bundle: Path) -> dict[str, str]:
    """Path -> role: the target that wrote the file, or what it is for. UsageError as above."""
    return _listed(bundle, "role")


def _listed(bundle: Path, word: str) -> dict[str, str]:
    manifest = read_json(bundle, "manifest.json")
    try:
        return {str(row["path"]): str(row[word]) for row in manifest["files"]}
    except (KeyError, TypeError) as error:
        raise UsageError(f"{bundle / 'manifest.json'}: not a manifest: {error}") from None


def read_json(bundle: Path, name: str) -> dict[str, Any]:  # Any: plain JSON
    """The object in a JSON file of a bundle. UsageError where there is none."""
    try:
        raw = json.loads(regular_bytes(bundle / name))
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(
            f"`{bundle}` is no bundle of this version: it has no {name}",
            hint="give a folder that `build` wrote, or build an older one again",
        ) from None
    except (ValueError, RecursionError, OSError) as error:
        raise UsageError(f"`{bundle / name}` is not JSON: {error}") from None
    if not isinstance(raw, dict):
        raise UsageError(f"`{bundle / name}` is no JSON object")
    return raw


def media_type(path: str) -> str:
    """Tell it by the suffix; licence texts and the like are plain text."""
    return _MEDIA_TYPES.get(PurePosixPath(path).suffix.lower(), "text/plain")


def notice(parts: Sequence[tuple[Recipe, Mapping[str, object]]]) -> BundleFile:
    """Where the robot comes from and that it was converted.

    parts: recipe and pin of the robot, then of each robot that is mounted on it.
    """
    lines = []
    edits = dict.fromkeys(edit.name for recipe, _ in parts for edit in recipe.edits)
    for recipe, pin in parts:
        source = recipe.source
        lines += [
            f"{recipe.robot}",
            "",
            f"Converted by assetbuild {__version__} from {source.origin},",
            f"file {source.description}.",
            *(f"{key}: {value}" for key, value in sorted(pin.items())),
            f"Licence of the source: {source.license or 'not stated in the recipe'}",
        ]
    lines += [
        "Changes: meshes converted and simplified, fixed joints merged, collision geometry,",
        "actuators and keyframes added as the recipe says; see model_card.md.",
        *([f"Edited: {', '.join(edits)}."] if edits else []),
    ]
    return BundleFile.of_text("NOTICE", "licence", "\n".join(lines) + "\n")


def package_url(name: str, version: str) -> str:
    """A distribution of the Python Package Index, as SLSA and others name it."""
    return f"pkg:pypi/{name.lower()}@{version}"


STATEMENT, PREDICATE = "https://in-toto.io/Statement/v1", "https://slsa.dev/provenance/v1"


def provenance(
    files: Iterable[BundleFile],
    recipe_digest: str,
    parameters: Mapping[str, object],
    materials: Iterable[Mapping[str, object]],
    run: Mapping[str, object],
) -> BundleFile:
    """`provenance.json`: in-toto Statement v1 with the SLSA v1 predicate.

    Times and hosts stand here alone. materials: resolved dependencies, each with `uri` or `digest`,
    as SLSA asks. run: `finishedOn`, and what has no name in SLSA, with the prefix `assetbuild_`.
    """
    statement = {
        "_type": STATEMENT,
        "subject": [
            {"name": file.path, "digest": {"sha256": file.sha256}}
            for file in sorted(files, key=lambda file: file.path)
        ],
        "predicateType": PREDICATE,
        "predicate": {
            "buildDefinition": {
                "buildType": "urn:assetbuild:bundle:v1",
                "externalParameters": {"recipe_sha256": recipe_digest, **parameters},
                "resolvedDependencies": list(materials),
            },
            "runDetails": {
                "builder": {"id": package_url("assetbuild", __version__)},
                "metadata": dict(run),
            },
        },
    }
    return BundleFile.of_text("provenance.json", "provenance", json_text(statement))


def same_provenance(one: bytes, other: bytes) -> bool:
    """Whether two `provenance.json` tell of the same build, run at whatever time and place."""
    content = _timeless(one)
    return content is not None and content == _timeless(other)


def _timeless(statement: bytes) -> object | None:
    """Leave out `runDetails.metadata`; None when it is no provenance."""
    try:
        content: dict[str, Any] = json.loads(statement)  # Any: JSON
        del content["predicate"]["runDetails"]["metadata"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return content
