"""How long a run takes to end after Ctrl-C: from the signal to the end of the process, results written.

    python pipelines/validation/faults/ctrl_c.py

Prints every time and the largest; a figure, not a test, since it is as large as the machine is busy.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STUDY = """
[study]
name = "ctrl-c"
seed = 7

[group.noisy]
realizations = 2000
starts = 500
fmax = [1.2, 8.0]
amplitude = [5.0]
"""


def seconds_to_end(folder: Path, out: Path, wait: float) -> float:
    """One run of more fits than it will do, stopped ``wait`` seconds after its first chunk is there."""
    words = [sys.executable, "-m", "mcstudy", "run", str(folder / "study.toml"), "-o", str(out)]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    while not any((out / "noisy" / "status").glob("c.*")):
        if process.poll() is not None:
            raise RuntimeError(process.communicate()[1])
        time.sleep(0.01)
    time.sleep(wait)
    sent = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate()
    seconds = time.monotonic() - sent
    if process.returncode != 3 or "Traceback" in errors:
        raise RuntimeError(errors)
    return seconds


def main() -> int:
    """Stop so many runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=10)
    args = parser.parse_args()
    chance, took = random.Random(0), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "study.toml").write_text(STUDY)
        for k in range(args.times):
            took.append(seconds_to_end(folder, folder / f"{k}.zarr", chance.uniform(0.0, 2.0)))
            print(f"{took[-1]:.2f} s", flush=True)
    took.sort()
    print(f"of {len(took)}: median {took[len(took) // 2]:.2f} s, largest {took[-1]:.2f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
