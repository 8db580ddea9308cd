"""Tiny steps, importable by child processes: the tests put this folder on `sys.path`."""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, Where
from assetbuild.findings import Finding


class Mix(Step):
    """Writes a digest of its inputs and salt; `keep` < 16 hex digits makes early cutoff likely."""

    outputs = ("out",)
    salt: int = 0
    keep: int = 16

    def run(self, files: Files) -> Iterable[Finding]:
        walked = os.walk(files.inputs, followlinks=True)
        names = sorted(Path(folder, name) for folder, _, names in walked for name in names)
        text = [str(self.salt)]
        text += [f"{p.relative_to(files.inputs)}={p.read_text()}" for p in names]
        mixed = hashlib.sha256("\n".join(text).encode()).hexdigest()[: self.keep]
        (files.outputs / "out").write_text(mixed)
        yield Finding("test.mixed", "info", "robot", mixed, data={"salt": self.salt, "nan": 1.5})


class MixInParent(Mix):
    in_parent: ClassVar[bool] = True


class MixInChild(Mix):
    isolated: ClassVar[bool] = True


class Split(Step):
    """One file per line of `in`, `name text`, into a folder."""

    outputs = ("parts/", "names.json")

    def run(self, files: Files) -> Iterable[Finding]:
        folder = files.outputs / "parts"
        folder.mkdir()
        names = []
        for line in (files.inputs / "in").read_text().splitlines():
            name, _, text = line.partition(" ")
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
            names.append(name)
        (files.outputs / "names.json").write_text(json.dumps(sorted(names)))
        return ()


class Write(Step):
    """Writes any files, declared or not."""

    outputs = ("out",)
    write: tuple[str, ...] = ("out",)

    def run(self, files: Files) -> Iterable[Finding]:
        for name in self.write:
            path = files.outputs / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(name)
        return ()


class PassOn(Step):
    """Links to what it read, under names of its own; or to `place`, which is no input."""

    outputs = ("out/", "same")
    place: str = ""

    def run(self, files: Files) -> Iterable[Finding]:
        (files.outputs / "out/deep").mkdir(parents=True)
        (files.outputs / "out/own").write_text("own")
        (files.outputs / "out/deep/parts").symlink_to(self.place or files.inputs / "parts")
        (files.outputs / "same").symlink_to(files.inputs / "names.json")
        return ()


class Misbehave(Step):
    """Fails in one of many ways, in a child process."""

    outputs = ("out",)
    isolated: ClassVar[bool] = True
    limits: ClassVar[Limits] = Limits(wall_s=30.0, memory_mb=300, file_mb=1)
    how: str

    def run(self, files: Files) -> Iterable[Finding]:
        (files.outputs / "out").write_text("x")
        getattr(self, f"do_{self.how}")(files)
        return ()

    def do_nothing(self, files: Files) -> None: ...

    def do_abort(self, files: Files) -> None:
        os.abort()

    def do_segfault(self, files: Files) -> None:
        os.kill(os.getpid(), signal.SIGSEGV)

    def do_hang(self, files: Files) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(60)

    def do_exit(self, files: Files) -> None:
        os._exit(3)

    def do_system_exit(self, files: Files) -> None:
        sys.exit(0)

    def do_memory(self, files: Files) -> None:
        held = [bytearray(64 << 20) for _ in range(20)]
        (files.outputs / "out").write_text(str(len(held)))

    def do_big_file(self, files: Files) -> None:
        (files.outputs / "out").write_bytes(bytes(3 << 20))

    def do_user_error(self, files: Files) -> None:
        raise SourceError("the mesh is cut off", where=Where("a.dae", 7, 3), hint="export it again")

    def do_bug(self, files: Files) -> None:
        raise KeyError("no such thing")

    def do_missing_package(self, files: Files) -> None:
        import no_such_package_anywhere  # noqa: F401 - it must fail

    def do_touch_input(self, files: Files) -> None:
        path = (files.inputs / "in").resolve()
        path.chmod(0o644)
        path.write_text("poisoned")

    def do_add_to_folder(self, files: Files) -> None:
        (files.inputs / "parts" / "more").write_text("poisoned")

    def do_read_environment(self, files: Files) -> None:
        names = ("OMP_NUM_THREADS", "HOME", "TZ", "LC_ALL", "PYTHONHASHSEED", "SECRET")
        seen: dict[str, object] = {name: os.environ.get(name) for name in names}
        seen |= {"cwd": str(Path.cwd()), "stdin": sys.stdin.read(), "path": sys.path}
        seen |= {"home_files": sorted(p.name for p in Path.home().iterdir())}
        (files.outputs / "out").write_text(json.dumps(seen))

    def do_leave_a_child(self, files: Files) -> None:
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
        (files.outputs / "out").write_text(str(child.pid))

    def do_print(self, files: Files) -> None:
        print("printed by the step")
        os.write(2, b"native message\n")


class Hang(Misbehave):
    limits: ClassVar[Limits] = Limits(wall_s=1.0)
    how: str = "hang"


class Meet(Step):
    """Waits until all others of the company have begun too. It declares much memory."""

    outputs = ("out",)
    isolated: ClassVar[bool] = True
    limits: ClassVar[Limits] = Limits(memory_mb=3000)
    number: int
    company: int
    folder: str
    patience_s: float = 300.0

    def run(self, files: Files) -> Iterable[Finding]:
        place = Path(self.folder)
        (place / str(self.number)).touch()
        deadline = time.monotonic() + self.patience_s
        while len(list(place.iterdir())) < self.company and time.monotonic() < deadline:
            time.sleep(0.01)
        (files.outputs / "out").write_text(str(len(list(place.iterdir()))))
        return ()


class Slow(Step):
    """Sleeps, in a child, and leaves its process id in a file outside (only a test may)."""

    outputs = ("out",)
    isolated: ClassVar[bool] = True
    seconds: float = 0.2
    pid_file: str = ""
    salt: int = 0

    def run(self, files: Files) -> Iterable[Finding]:
        if self.pid_file:
            Path(self.pid_file).write_text(str(os.getpid()))
        time.sleep(self.seconds)
        (files.outputs / "out").write_text(f"{self.salt}")
        return ()


class Preloaded(Step):
    """Says whether its module was imported before the fork, by which process, and of threads."""

    outputs = ("out",)
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = ("colorsys",)
    salt: int = 0

    def run(self, files: Files) -> Iterable[Finding]:
        seen = {"loaded": self.preload[0] in sys.modules, "worker": os.getppid()}
        seen["threads"] = threading.active_count()
        (files.outputs / "out").write_text(json.dumps(seen))
        return ()


class Count(Step):
    """Leaves one line in a file outside for every run (only a test may)."""

    outputs = ("out",)
    log: str
    name: str
    text: str = ""
    seconds: float = 0.0

    def run(self, files: Files) -> Iterable[Finding]:
        with Path(self.log).open("a") as log:
            log.write(f"{self.name}\n")
        time.sleep(self.seconds)
        read = [p.read_text() for p in sorted(files.inputs.iterdir())]
        (files.outputs / "out").write_text("+".join([self.text or self.name, *read]))
        return ()


class CountInParent(Count):
    in_parent: ClassVar[bool] = True


class DiesOnce(Step):
    """Killed by a signal after it wrote a part; well when it is run again."""

    outputs = ("out",)
    isolated: ClassVar[bool] = True
    flag: str
    signal_name: str

    def run(self, files: Files) -> Iterable[Finding]:
        if not Path(self.flag).exists():
            Path(self.flag).touch()
            (files.outputs / "left behind").touch()
            os.kill(os.getpid(), signal.Signals[self.signal_name])
            time.sleep(5)
        (files.outputs / "out").write_text("alive")
        return ()


class Edit(Step):
    """Edits a source while it runs, as a user with an editor may."""

    outputs = ("out",)
    path: str

    def run(self, files: Files) -> Iterable[Finding]:
        text = "".join(p.read_text() for p in sorted(files.inputs.rglob("*")) if p.is_file())
        source = Path(self.path)
        if source.read_text() == "1":
            source.write_text("2")
        (files.outputs / "out").write_text(text)
        return ()


class Irreproducible(Step):
    """Gives other bytes in every run, in one file of a folder."""

    outputs = ("parts/", "same")

    def run(self, files: Files) -> Iterable[Finding]:
        (files.outputs / "parts").mkdir()
        (files.outputs / "parts/steady").write_text("steady")
        (files.outputs / "parts/clock").write_text(str(time.monotonic_ns()))
        (files.outputs / "same").write_text("same")
        return ()


def flip(path: Path) -> None:
    """Change one bit of an object of the store."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.chmod(0o644)
    path.write_bytes(data)


class PreloadedWithThreads(Preloaded):
    preload: ClassVar[tuple[str, ...]] = ("threaded_for_tests",)


CORENAMES = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename")


class Kernels(Step):
    """Computes with whatever kernels the libraries choose in its process.

    Writes what was chosen, and digests of numbers that another choice changes.
    """

    outputs = ("chosen.json", "numbers.json")
    preload: ClassVar[tuple[str, ...]] = ("numpy", "scipy.linalg")

    def run(self, files: Files) -> Iterable[Finding]:
        (files.outputs / "chosen.json").write_text(json.dumps(chosen()))
        (files.outputs / "numbers.json").write_text(json.dumps(numbers()))
        return ()


def chosen() -> dict[str, object]:
    """The kernels of each OpenBLAS that is loaded, and numpy's dispatched features."""
    import numpy._core._multiarray_umath as umath

    lines = Path("/proc/self/maps").read_text().splitlines()
    found = {}
    for path in {line.split()[-1] for line in lines if "openblas" in line}:
        library = ctypes.CDLL(path)
        name = next(name for name in CORENAMES if hasattr(library, name))
        corename = getattr(library, name)
        corename.restype = ctypes.c_char_p
        found[Path(path).name] = corename().decode()
    has = umath.__cpu_features__
    return {"blas": found, "numpy": [name for name in umath.__cpu_dispatch__ if has[name]]}


def numbers() -> dict[str, str]:
    """BLAS, numpy's own loops and libm on the same numbers each time."""
    import numpy as np
    import scipy.linalg

    random = np.random.RandomState(0)
    a, b, x = random.rand(97, 63), random.rand(63, 41), random.rand(10_007) * 20 - 10
    libm = [f(v) for v in x.tolist() for f in (math.sin, math.exp, math.atan)]
    computed = {
        "product": a @ b,
        "eigenvalues": np.linalg.eigvalsh(a.T @ a),
        "solution": scipy.linalg.lstsq(a, np.ones(97))[0],
        "exp": np.exp(x),
        "power": np.abs(x) ** 1.3,
        "sine": np.sin(x),
        "libm": np.array(libm),
    }
    return {name: hashlib.sha256(each.tobytes()).hexdigest() for name, each in computed.items()}


class Sharing(Misbehave):
    """Where the next of its kind may follow in the same process."""

    shares: ClassVar[bool] = True
    limits: ClassVar[Limits] = Limits(wall_s=5.0, memory_mb=300, file_mb=1)
    salt: int = 0

    def do_say_who(self, files: Files) -> None:
        seen = {"pid": os.getpid(), "inputs": str(files.inputs), "cwd": str(Path.cwd())}
        seen |= {"tmp": tempfile.gettempdir(), "files": os.listdir()}  # noqa: PTH208
        (Path.home() / "litter").mkdir()
        (Path.home() / "litter/file").touch()
        (files.outputs / "out").write_text(json.dumps(seen))

    def do_burn(self, files: Files) -> None:
        while time.process_time() < 0.5:
            pass
        self.do_say_who(files)

    def do_leave_a_thread(self, files: Files) -> None:
        threading.Thread(target=time.sleep, args=(60,), daemon=True).start()

    def do_need_much(self, files: Files) -> None:
        held = b"x" * (280 << 20)
        (files.outputs / "out").write_text(str(len(held)))
