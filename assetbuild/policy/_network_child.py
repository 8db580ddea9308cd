"""The program that runs a policy's network: one file of a stranger, few rights, little memory.

Tells on its standard output what the file is, as a line of JSON; then answers each observation,
float32, with all outputs, float32, until its standard input ends.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path
from typing import Any

MEMORY_BYTES = 4 << 30
FLOATS = "tensor(float)"


def main(path: str) -> None:
    """Load the network, say what it is, serve."""
    answer = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what the library prints is no answer
    try:
        session = _session(path)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        description: dict[str, Any] = {
            "inputs": [[one.name, _shape(one)] for one in inputs],
            "outputs": [[one.name, _shape(one)] for one in outputs],
            "metadata": dict(session.get_modelmeta().custom_metadata_map),
        }
    except Exception as error:  # whatever the library says is the answer
        description = {"error": " ".join(str(error).split())[:600]}
    answer.write(json.dumps(description).encode() + b"\n")
    if "error" not in description:
        _serve(session, inputs, answer)


def _session(path: str) -> Any:
    import onnxruntime

    from assetbuild.engine.confine import confine

    # What `onnxruntime` still opens lies beside it; of the user's files only the policy's folder.
    beside = [str(file.resolve()) for file in Path(path).parent.iterdir() if file.is_symlink()]
    confine([str(Path(path).parent), *beside, *_libraries()])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    onnxruntime.set_default_logger_severity(4)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def _libraries() -> list[str]:
    places = [*sys.path, "/proc", "/sys/devices/system/cpu", "/usr/lib", "/lib"]
    return [place for place in dict.fromkeys(places) if place and Path(place).exists()]


def _shape(one: Any) -> list[int]:
    """Sizes; 1 for a size that is free, such as that of the batch."""
    if one.type != FLOATS:
        raise ValueError(f"`{one.name}` is a {one.type}, not a {FLOATS}")
    return [size if isinstance(size, int) else 1 for size in one.shape]


def _serve(session: Any, inputs: Any, answer: Any) -> None:
    import numpy as np

    names, shapes = [one.name for one in inputs], [_shape(one) for one in inputs]
    sizes = [int(np.prod(shape)) for shape in shapes]
    count = 4 * sum(sizes)
    while len(data := sys.stdin.buffer.read(count)) == count:
        parts = np.split(np.frombuffer(data, dtype=np.float32), np.cumsum(sizes)[:-1])
        fed = {n: p.reshape(s) for n, p, s in zip(names, parts, shapes, strict=True)}
        outputs = session.run(None, fed)
        answer.write(b"".join(np.asarray(one, dtype=np.float32).tobytes() for one in outputs))


if __name__ == "__main__":
    main(sys.argv[1])
