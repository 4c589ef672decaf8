"""``mcstudy`` with clocks on its parts: ``python -m pipelines.benchmarks.traced OUT.json ARGUMENTS...``.

The program runs unchanged; here a few of its functions are replaced by themselves with a clock around. A call costs
about a microsecond more, and the kernel is called once per cell. Times are CPU times of the calling thread; what a
part spends in another part is taken out of it.
"""

from __future__ import annotations

import functools
import importlib
import json
import resource
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

PARTS = {
    "kernel": [("mcstudy.fitting.kernel", None, "levenberg_marquardt")],
    "stability": [("mcstudy.study.execution.tasks", None, "growth_rate")],
    "data": [("mcstudy.study.experiment", "Experiment", "measure")],
    "starts": [("mcstudy.study.experiment", "Experiment", "starts")],
    "store": [
        ("mcstudy.study.cube.store", "GroupStore", "write"),
        ("mcstudy.study.cube.store", "GroupStore", "existing"),
    ],
    "cube made": [("mcstudy.study.run", None, "open_or_create")],
    "solver around the kernel": [("mcstudy.study.execution.tasks", None, "fit_queue")],
    "task around all these": [("mcstudy.study.execution.tasks", None, "run_task")],
}

spent: dict[str, float] = defaultdict(float)
_inside = threading.local()
_lock = threading.Lock()


def _clocked(part: str, function: Any) -> Any:
    @functools.wraps(function)
    def wrapper(*arguments: Any, **named: Any) -> Any:
        outer, _inside.children = getattr(_inside, "children", 0.0), 0.0
        begun = time.thread_time()
        try:
            return function(*arguments, **named)
        finally:
            took = time.thread_time() - begun
            with _lock:
                spent[part] += took - _inside.children
            _inside.children = outer + took

    return wrapper


def _install() -> None:
    for part, places in PARTS.items():
        for module, owner, name in places:
            holder = importlib.import_module(module)
            if owner is None:
                setattr(holder, name, _clocked(part, getattr(holder, name)))
                continue
            cls = getattr(holder, owner)
            if name in vars(cls):
                setattr(cls, name, _clocked(part, vars(cls)[name]))
            else:  # set by __init__ on every instance
                _clock_instances(cls, name, part)


def _clock_instances(cls: Any, name: str, part: str) -> None:
    prepare = cls.__init__

    @functools.wraps(prepare)
    def init(self: Any, *arguments: Any, **named: Any) -> None:
        prepare(self, *arguments, **named)
        setattr(self, name, _clocked(part, getattr(self, name)))

    cls.__init__ = init


def main() -> int:
    """Run the program and write what its parts took."""
    out, *arguments = sys.argv[1:]
    begun, before = time.perf_counter(), time.process_time()
    import mcstudy.study.execution.tasks
    import mcstudy.study.run
    from mcstudy.cli import main as program

    imports = time.process_time() - before
    _install()
    mcstudy.study.run.run_task = mcstudy.study.execution.tasks.run_task  # tasks are sent by name
    code = program(arguments)
    whole = time.process_time()
    document = {
        "seconds": {**spent, "start of the interpreter": before, "imports": imports},
        "cpu": whole,
        "wall": time.perf_counter() - begun,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024),
    }
    Path(out).write_text(json.dumps(document))
    return code


if __name__ == "__main__":
    raise SystemExit(main())
