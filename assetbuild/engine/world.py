"""The one door to the world: each question that a build puts to it is recorded with its answer.

The world is what lies outside the store: files, folders, links, environment variables, installed
modules and libraries. A question is asked once; every step of a build gets the same answer. The
null build asks all of them again, and `watch`, the provenance and the list of files that were read
come from the same record.
"""

from __future__ import annotations

import copy
import ctypes
import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.questions import (
    BETWEEN,
    BYTES,
    KIND,
    LINK,
    NAMES,
    STAMP,
    VARIABLE,
    Question,
    answer,
    pattern_of,
)
from assetbuild.engine.stamps import Stamps
from assetbuild.errors import SourceError

Record = dict[Question, str]
"""Questions with their answers, in the order in which they were asked."""

MOST_LINKS = 40
"""Links on the way to a file; the kernel gives up after as many."""
LOADER_FOLDERS = ("/lib", "/usr/lib", "/lib64", "/usr/lib64", "/usr/local/lib")
"""Where the loader looks besides its cache; a multiarch system has folders below them."""


class World:
    """What a build asks about the world, as it was first answered.

    record: what was asked here. whole: the world that this is a part of; its record holds what all
    parts asked. Paths may be relative to the working folder.
    """

    def __init__(self) -> None:
        self.record: Record = {}
        self.stamps = Stamps()
        self.whole = self
        self._files: dict[str, Path] = {}

    def part(self) -> World:
        """The same world with a record of its own, for one of several plans."""
        part = copy.copy(self)
        part.record = {}
        return part

    def _ask(self, question: Question, how: Callable[[Question], str] = answer) -> str:
        known = self.whole.record
        reply = known.get(question)
        if reply is None:
            reply = known.setdefault(question, how(question))
        self.record[question] = reply
        return reply

    # -- bytes

    def digest(self, path: Path) -> str:
        """SHA-256 of a file. SourceError when it cannot be read."""
        return self._ask((BYTES, str(path.absolute()), ""), self._digest)

    def _digest(self, question: Question) -> str:
        path = question[1]
        try:
            digest = self.whole.stamps.digest(path)
        except OSError as error:
            self._ask((STAMP, path, ""))  # `watch` waits for what can be read
            reason = error.strerror or str(error)
            raise SourceError(f"cannot read `{path}`: {reason}") from None
        self._files[digest] = Path(path)
        return digest

    def saw(self, path: Path, data: bytes) -> None:
        """A file was read just now, and these were its bytes; it may be a step's input, too."""
        place = path.absolute()
        digest = self._ask((BYTES, str(place), ""), lambda _: digest_bytes(data))
        self._files[digest] = place

    def wrote(self, path: Path, data: bytes) -> None:
        """This build itself wrote a file: what was answered about it before holds no longer."""
        place = str(path.absolute())
        for record in (self.record, self.whole.record):
            for question in [each for each in record if each[1] == place]:
                del record[question]
        self.saw(path, data)

    def check(self, paths: Iterable[str]) -> None:
        """SourceError when one of these files is not what it was when first seen."""
        for path in paths:
            try:
                same = self.whole.stamps.digest(path) == self.digest(Path(path))
            except OSError:
                same = False
            if not same:
                raise edited(Path(path))

    def file_of(self, digest: str) -> Path | None:
        """A file that had these bytes when it was first seen."""
        return self._files.get(digest)

    # -- names and places

    def is_file(self, path: Path) -> bool:
        """Is a regular file there, behind all links?"""
        return self._kind(path) == "file"

    def is_folder(self, path: Path) -> bool:
        """Is a folder there, behind all links?"""
        return self._kind(path) == "folder"

    def exists(self, path: Path) -> bool:
        """Is anything there, if only a link that leads nowhere?"""
        return bool(self._kind(path) or self._link(path))

    def _kind(self, path: Path) -> str:
        return self._ask((KIND, str(path.absolute()), ""))

    def _link(self, path: Path) -> str:
        return self._ask((LINK, str(path.absolute()), ""))

    def real(self, path: Path) -> Path:
        """Where a path leads behind all links; of a circle of them some place in it."""
        place, pending, links = Path("/"), list(reversed(path.absolute().parts[1:])), 0
        while pending:
            name = pending.pop()
            if name == "..":
                place = place.parent
                continue
            target = Path(self._link(place / name))
            if links < MOST_LINKS and target.parts:
                links += 1
                place = Path("/") if target.is_absolute() else place
                pending += reversed([part for part in target.parts if part != "/"])
            else:
                place /= name
        return place

    def plain(self, path: Path) -> Path:
        """The absolute path without `..`, which behind a link leads elsewhere than it reads."""
        place = Path("/")
        for name in path.absolute().parts[1:]:
            if name != "..":
                place /= name
            else:
                place = (self.real(place) if self._link(place) else place).parent
        return place

    def names(
        self, folder: Path, *, starts: tuple[str, ...] = (), ends: tuple[str, ...] = ()
    ) -> tuple[str, ...]:
        """Names in a folder that begin and end so, in whatever case; a folder's ends in a slash.

        starts, ends: in lower case; () = any.
        """
        return self._names(folder, pattern_of(starts, ends))

    def _names(self, folder: Path, pattern: str) -> tuple[str, ...]:
        reply = self._ask((NAMES, str(folder.absolute()), pattern))
        return tuple(reply.split(BETWEEN)) if reply else ()

    def below(
        self,
        folder: Path,
        ends: tuple[str, ...],
        but: tuple[str, ...] = (),
        passed: Callable[[Path], bool] = lambda _: False,
    ) -> Iterator[Path]:
        """Files and links below a folder whose names end so; not in hidden folders, no link.

        but: see `pattern_of`. passed: of a folder, whether to pass it by.
        """
        pending = [folder]
        pattern = pattern_of((), ends, deep=True, but=but)
        while pending:
            here = pending.pop()
            for name in self._names(here, pattern):
                if not name.endswith("/"):
                    yield here / name
                elif not passed(here / name):
                    pending.append(here / name)

    # -- the machine

    def variable(self, name: str) -> str | None:
        """An environment variable; None = not set."""
        reply = self._ask((VARIABLE, name, ""))
        return reply[1:] if reply else None

    def has_module(self, name: str) -> bool:
        """Can Python import it? Nothing is imported to find out. name: without dots."""
        spec = importlib.util.find_spec(name)
        if spec is None:
            for folder in sys.path:
                self.names(Path(folder), starts=(name.lower(),))
            return False
        places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
        for place in places:
            self._kind(Path(place))
        return True

    def installed(self, modules: Iterable[str]) -> None:
        """Note which distributions there are, and the files of modules that plug in; see `Code`.

        modules: top-level ones, maybe not imported yet. Where a distribution lies among others,
        the stamp of that folder is part of the null build's identity.
        """
        self.variable("PYTHONPATH")
        for folder in sys.path:
            if not folder.endswith("-packages"):
                for name in self.names(Path(folder), ends=(".dist-info", ".egg-info")):
                    points = Path(folder, name, "entry_points.txt")
                    if self.is_file(points):
                        self.digest(points)
        for module in modules:
            spec = importlib.util.find_spec(module)
            if spec is None:
                continue
            if spec.origin and not spec.submodule_search_locations:
                self.digest(Path(spec.origin))
            for folder in spec.submodule_search_locations or ():
                for path in self.below(Path(folder), ()):
                    if self.is_file(path):
                        self.digest(path)

    def can_load(self, library: str) -> bool:
        """Does the loader find a shared library, such as `libEGL.so.1`?"""
        search_path = self.variable("LD_LIBRARY_PATH") or ""
        self._ask((STAMP, "/etc/ld.so.cache", ""))
        try:
            ctypes.CDLL(library)
        except OSError:
            folders = [*filter(None, search_path.split(":")), *LOADER_FOLDERS, f"{sys.prefix}/lib"]
            for folder in folders:
                self.names(Path(folder), starts=(library.lower(),))
            return False
        for path in _loaded(library):
            self._ask((STAMP, path, ""))
        return True


def _loaded(library: str) -> list[str]:
    """The files behind a library of this process, where the system lists them."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    paths = {line.split(maxsplit=5)[-1] for line in lines if "/" in line}
    return sorted(path for path in paths if Path(path).name.startswith(library))


def files_in(record: Mapping[Question, str]) -> dict[str, str]:
    """Path -> SHA-256 of every file whose bytes a record holds."""
    return {path: digest for (kind, path, _), digest in record.items() if kind == BYTES}


def edited(source: Path) -> SourceError:
    """A source changed between its first reading and now."""
    return SourceError(f"`{source}` was edited during the build", hint="run the build again")
