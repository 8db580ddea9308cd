"""Servers that others keep, started as the documentation says: bazel-remote and nginx.

A test is skipped where the program of its server is not installed.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import yaml
from builds_for_tests import assert_second_machine_builds_nothing

DOCS = Path(__file__).parents[2] / "docs/how-to"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def bazel_remote(folder: Path, port: int) -> list[str]:
    service = yaml.safe_load((DOCS / "cache-compose.yaml").read_text())["services"]["cache"]
    words = service["command"].replace("/data", str(folder / "data")).replace("8080", str(port))
    return ["bazel-remote", "--host", "127.0.0.1", *words.split()]


def nginx(folder: Path, port: int) -> list[str]:
    text = (DOCS / "cache-nginx.conf").read_text().replace("8080", f"127.0.0.1:{port}")
    (folder / "data").mkdir()
    (folder / "nginx.conf").write_text(text.replace("/var/cache/assetbuild", str(folder / "data")))
    user = "user root;" if os.geteuid() == 0 else ""
    own = f"daemon off; pid {folder}/pid; error_log {folder}/log; {user}"
    return ["nginx", "-p", str(folder), "-c", str(folder / "nginx.conf"), "-g", own]


@contextmanager
def running(command: list[str], port: int) -> Iterator[None]:
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            for _ in range(300):
                with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                    break
                assert process.poll() is None, f"{command[0]} ended"
                time.sleep(0.1)
            yield
        finally:
            process.terminate()


@pytest.fixture(params=[bazel_remote, nginx], ids=["bazel-remote", "nginx"])
def server(request, tmp_path: Path):
    folder, port = tmp_path / "server", free_port()
    folder.mkdir()
    command = request.param(folder, port)
    program = shutil.which(command[0], path=f"{os.environ['PATH']}:/usr/sbin")
    if program is None:
        pytest.skip(f"needs the program `{command[0]}`")
    with running([program, *command[1:]], port):
        yield f"http://127.0.0.1:{port}"


def test_the_second_machine_builds_nothing(tmp_path: Path, robot: Path, server: str):
    assert_second_machine_builds_nothing(tmp_path, robot, server)
