"""The program that runs a policy's network: one file of a stranger, few rights, little memory.

Writes what the file is on its standard output; then answers each line of its standard input, the
numbers of each of the network's inputs, with those of each output. All are lines of JSON.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path
from typing import Any, TextIO

MEMORY_BYTES = 4 << 30
FLOATS = "tensor(float)"


def main(path: str) -> None:
    """Load the network, say what it is, serve."""
    answer = os.fdopen(os.dup(1), "w", buffering=1, encoding="ascii")
    os.dup2(2, 1)  # what the library prints is no answer
    try:
        session = _session(path)
        description: dict[str, Any] = {
            "inputs": [(one.name, _shape(one)) for one in session.get_inputs()],
            "outputs": [(one.name, _shape(one)) for one in session.get_outputs()],
            "metadata": dict(session.get_modelmeta().custom_metadata_map),
        }
        if not description["inputs"]:
            raise ValueError("it takes no input")
    except Exception as error:  # whatever the library says is the answer
        description = {"error": " ".join(str(error).split())[:600]}
    answer.write(json.dumps(description) + "\n")
    if "error" not in description:
        _serve(session, description["inputs"], answer)


def _session(path: str) -> Any:
    import onnxruntime

    from assetbuild.engine.confine import confine

    # What `onnxruntime` still opens lies beside it; of the user's files only the policy's folder.
    beside = [str(file.resolve()) for file in Path(path).parent.iterdir() if file.is_symlink()]
    places = [*sys.path, "/proc", "/sys/devices/system/cpu", "/usr/lib", "/lib"]
    libraries = [place for place in dict.fromkeys(places) if place and Path(place).exists()]
    confine([str(Path(path).parent), *beside, *libraries])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    onnxruntime.set_default_logger_severity(4)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def _shape(one: Any) -> list[int]:
    """Sizes; 1 for a size that is free, such as that of the batch."""
    if one.type != FLOATS:
        raise ValueError(f"`{one.name}` is a {one.type}, not a {FLOATS}")
    return [size if isinstance(size, int) else 1 for size in one.shape]


def _serve(session: Any, inputs: list[tuple[str, list[int]]], answer: TextIO) -> None:
    import numpy as np

    for line in sys.stdin:
        rows = zip(inputs, json.loads(line), strict=True)
        fed = {name: np.array(row, np.float32).reshape(shape) for (name, shape), row in rows}
        outputs = session.run(None, fed)
        answer.write(json.dumps([np.ravel(one).tolist() for one in outputs]) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
