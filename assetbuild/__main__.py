"""The entry point. A build with nothing to do is answered before anything else is imported."""

from __future__ import annotations

import gc
import os
import sys


def main() -> int:
    """Run the command line; returns the exit code."""
    argv = sys.argv[1:]
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115, PTH123 # closed; as below
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115, PTH123 # as above
    try:
        here = os.getcwd()  # noqa: PTH109 # pathlib is not loaded here
    except FileNotFoundError:
        print("error: the folder that this was started in no longer exists", file=sys.stderr)
        return 2
    # GitHub wants its summary from every run, and a null build has none to give.
    asks_more = "--rehash" in argv or os.environ.get("GITHUB_STEP_SUMMARY")
    if argv[:1] == ["build"] and not asks_more:
        code = _null_build(here, argv)
        if code is not None:
            return code
    gc.set_threshold(200_000, 20)  # imports and records make many objects and little garbage
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # as the workers
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # nothing is computed here
    from assetbuild.cli import main as run

    return run(argv)


def _null_build(here: str, argv: list[str]) -> int | None:
    """The exit code of a build with nothing to do; None when there may be something."""
    from assetbuild.engine.machine import cache_root
    from assetbuild.engine.noop_build import check, record_file

    options = "\n".join((here, *argv))
    record = check(record_file(cache_root(), options), options)
    if record is None:
        return None
    sys.stdout.write(str(record["summary"]))
    return int(str(record["exit_code"]))


if __name__ == "__main__":
    sys.exit(main())
