"""What does the diagnosis say about mislabelled recordings?

    python pipelines/validation/mislabelled.py
    python pipelines/validation/mislabelled.py --only "stimulus" --recordings 1 2
    python pipelines/validation/mislabelled.py --sound 63

Every way to mislabel a recording (`pipelines.validation.mislabelled_recordings`) is applied to the same sound
recordings, and the answer of the diagnosis falls in one class: refused with the right words, refused with other words,
named as the cause in the recording, another cause in the recording, outside the library, a technical cause (stimulus or
sensor), a physiological cause (any effect in ankle, hip or body; counted with its probability above 50 % only), or no
gap. A line per mislabelling is followed by the totals with their 95 % intervals. ``--sound N`` diagnoses N sound
recordings instead: none may be called mislabelled.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence

from mcstudy_challenge.scores.rates import rate

from mcstudy.text_tables import table
from pipelines import measured
from pipelines.validation.mislabelled_answers import CLASSES, answered
from pipelines.validation.mislabelled_recordings import KINDS, MISLABELLINGS, sound

RIGHT = ("refused, right words", "right recording cause")
"""Of the classes of answers."""


def rows(only: str, recordings: Sequence[int], verbose: bool) -> dict[str, list[str]]:
    """The class of every answer, by mislabelling."""
    found: dict[str, list[str]] = {m.name: [] for m in MISLABELLINGS if only in m.name}
    for seed in recordings:
        it = sound(seed)
        for m in MISLABELLINGS:
            if m.name in found:
                answer = answered(m.change(it), m.codes)
                found[m.name].append(answer.kind)
                if verbose:
                    print(f"{m.name} | {it.recording.name} | {answer.kind} | {answer.words}", flush=True)
    return found


def main() -> None:
    """Diagnose, count, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="only mislabellings whose name contains this text")
    parser.add_argument("--recordings", type=int, nargs="+", default=range(KINDS), help="which sound recordings")
    parser.add_argument("--sound", type=int, help="diagnose this many sound recordings instead")
    parser.add_argument("--verbose", action="store_true", help="print every answer")
    measured.add_option(parser)
    args = parser.parse_args()
    began = time.process_time()
    if args.sound:
        found: dict[str, list[str]] = {"sound": []}
        for seed in range(args.sound):
            answer = answered(sound(seed).recording, ())
            found["sound"].append(answer.kind)
            if args.verbose:
                print(f"sound | {seed} {sound(seed).effect} | {answer.kind} | {answer.words}", flush=True)
    else:
        found = rows(args.only, args.recordings, args.verbose)
    counts = {name: Counter(kinds) for name, kinds in found.items()}
    body = [[name, *(str(c[k]) if c[k] else "" for k in CLASSES)] for name, c in counts.items()]
    print(table(["mislabelling", *CLASSES], body))
    every = [kind for kinds in found.values() for kind in kinds]
    print()
    for k in CLASSES:
        print(f"{k}: {rate(x == k for x in every).text()} of {len(every)}")
    right = rate(x in RIGHT for x in every)
    shares = [[k, rate(x == k for x in every).text()] for k in CLASSES]
    share = {"value": 100 * right.value, "low": 100 * right.low, "high": 100 * right.high, "unit": "%"}
    measured.write(args.json, {"right": share}, {"answers": (["answer", "share [95 %]"], shares)})
    print(f"CPU time: {time.process_time() - began:.0f} s")


if __name__ == "__main__":
    main()
