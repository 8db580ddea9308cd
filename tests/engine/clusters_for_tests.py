"""A scheduler and workers of dask on this machine, started as the documentation says."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

CACHE_KEY = "k"
HERE = Path(__file__).parent


@dataclass
class LocalCluster:
    """workers: their processes. Each has a store of its own, `<folder>/worker<n>`."""

    folder: Path
    address: str = ""
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start_worker(self) -> None:
        number = len(self.workers)
        command = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        local = ["--local-directory", str(self.folder / f"local{number}")]
        self.workers.append(self._start([*command, *local], f"worker{number}"))

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        file = self.folder / "scheduler.json"
        words = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        process = self._start([*words, "--scheduler-file", str(file)], "scheduler")
        for _ in range(600):
            with suppress(OSError, ValueError):
                self.address = json.loads(file.read_text())["address"]
                return process
            time.sleep(0.1)
        raise AssertionError("the scheduler did not start")

    def _start(self, words: list[str], name: str) -> subprocess.Popen[bytes]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        kept |= {"ASSETBUILD_CACHE": str(self.folder / name), "ASSETBUILD_CACHE_KEY": CACHE_KEY}
        kept["PYTHONPATH"] = os.pathsep.join([str(HERE), kept.get("PYTHONPATH", "")])
        with (self.folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *words], env=kept, stdout=log, stderr=log
            )

    @property
    def executor(self) -> str:
        return self.address.replace("tcp://", "dask://")

    def wait_for(self, count: int) -> None:
        from distributed import Client

        with Client(self.address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)

    def revive(self) -> None:
        """Two living workers, whatever an earlier test did."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < 2:
            self.start_worker()
        self.wait_for(2)


@contextmanager
def cluster(folder: Path) -> Iterator[LocalCluster]:
    started = LocalCluster(folder)
    scheduler = started.start_scheduler()
    try:
        yield started
    finally:
        for process in (*started.workers, scheduler):
            with suppress(OSError):
                process.send_signal(signal.SIGKILL)
            process.wait()
