"""The command line: verbs parse, call and print. Nothing heavy is imported before it is needed."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from assetbuild.cli.parser import recipes_of
from assetbuild.cli.verbs import VERBS, make_parser, runner
from assetbuild.errors import AssetBuildError, MachineError, one_line

__all__ = ["VERBS", "Terminated", "main", "make_parser", "print_error"]
MOST_ERRORS = 20
"""So many errors are shown; a recipe that is no recipe has thousands."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    _print_any_name()
    parser = make_parser()
    arguments = parser.parse_args(argv)
    if arguments.verb is None:
        parser.print_help()
        return 0
    if "recipes" in arguments:
        arguments.recipes = recipes_of(arguments.recipes)
    _end_as_by_ctrl_c()
    _show_plugin_warnings()
    if arguments.verb == "build" and not arguments.dry_run:
        from assetbuild.engine import children

        children.begin()
    try:
        code = runner(arguments.verb)(arguments)
        sys.stdout.flush()  # what the output refuses is refused here, and not at the exit
        return code
    except AssetBuildError as error:
        print_error(error)
        return error.exit_code
    except Terminated:
        print("terminated; what is finished is kept", file=sys.stderr)
        return 143
    except KeyboardInterrupt:
        print("interrupted; what is finished is kept", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output is gone: nobody is left to tell
        sys.stderr.close()
        return 1
    except Exception as error:  # the last resort: a user gets a sentence
        print_error(_folder_removed() or _refused(error) or _bug(error))
        return 1


def _folder_removed() -> AssetBuildError | None:
    """Whether somebody removed the working folder meanwhile: then nothing can be written there."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return AssetBuildError(
            "the working folder was removed while assetbuild ran in it",
            hint="start it again in a folder that stays; what is finished is in the store",
        )
    return None


REFUSALS = {
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT,
    errno.EEXIST, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG,
}  # fmt: skip
"""What the system says of a file or folder that it does not give."""


def _refused(error: Exception) -> AssetBuildError | None:
    if not isinstance(error, OSError) or error.errno not in REFUSALS:
        return None
    if error.filename:
        return MachineError(f"cannot read or write `{error.filename}`: {error.strerror}")
    if error.errno in (errno.ENOSPC, errno.EDQUOT):  # no name: the standard output may be a file
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123 # else refused again at the exit
        return MachineError(f"cannot write: {error.strerror}", hint="free some space")
    return None


def _bug(error: Exception) -> AssetBuildError:
    """The sentence for what nobody foresaw; the traceback goes to a file, where there is room."""
    text = one_line(error, 300)
    message = f"a bug in assetbuild: {type(error).__name__}{': ' + text if text else ''}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", errors="replace", prefix="assetbuild-", suffix=".txt",
            delete=False,
        ) as file:  # fmt: skip
            traceback.print_exception(error, file=file)
    except OSError:
        return AssetBuildError(message, hint="please report it, with the command")
    return AssetBuildError(message, hint=f"please report it, with the command and {file.name}")


class Terminated(KeyboardInterrupt):
    """SIGTERM: children are killed and what is learnt is saved, as with Ctrl-C."""


def _end_as_by_ctrl_c() -> None:
    """The first signal ends the build in order; a second one cannot disturb that (2 s at most)."""
    if threading.current_thread() is not threading.main_thread():
        return

    def leave(number: int, _: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated if number == signal.SIGTERM else KeyboardInterrupt

    signal.signal(signal.SIGTERM, leave)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else `nohup` or a parent
        signal.signal(signal.SIGINT, leave)


def _print_any_name() -> None:
    """File names need not be text, and a terminal need not know every letter."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _show_plugin_warnings() -> None:
    """One line for each plug-in that is left out, once."""
    shown = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:  # Any: unread
        if category.__name__ == "PluginWarning":
            print(f"warning: {message}", file=sys.stderr)
        else:
            shown(message, category, *place)

    warnings.showwarning = show  # type: ignore[assignment] # its names of `place` are not ours


def print_error(error: AssetBuildError) -> None:
    """What, where, next move, of each error that was found; on stderr."""
    errors = error.each()
    for each in errors[:MOST_ERRORS]:
        print(f"error: {each}", file=sys.stderr)
    more = len(errors[MOST_ERRORS:]) + error.uncounted
    if more:
        print(f"and {more} more errors", file=sys.stderr)
