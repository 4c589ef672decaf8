"""Are stated probabilities right where another share of the recordings lacks nothing?

    python pipelines/validation/challenge_shares.py -o DIR

Runs the short benchmark (``pipelines/gap_challenge_small.toml``, two minutes on two cores), or resumes it, and scores
its answers as if other shares of the recordings lacked nothing (`mcstudy gap challenge score --share-none`).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mcstudy.cli import main as mcstudy
from pipelines import measured

FILE = measured.ROOT / "pipelines" / "gap_challenge_small.toml"

COLUMNS = {
    "first": "most probable hypothesis: stated minus right",
    "none": "nothing missing: stated minus share",
    "log_loss": "log loss",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the benchmark")
    measured.add_option(parser)
    args = parser.parse_args()
    if code := mcstudy(["gap", "challenge", "run", str(FILE), "-o", str(args.out)]):
        raise SystemExit(code)
    score = json.loads((args.out / "score.json").read_text(encoding="utf-8"))
    rows = [
        [f"{100 * share['nulls']:.0f} %", *(_text(share[name]) for name in COLUMNS)] for share in score["other_shares"]
    ]
    measured.write(args.json, tables={"shares": (["share that lacks nothing", *COLUMNS.values()], rows)})


def _text(figure: dict[str, float]) -> str:
    value, low, high = (round(figure[end], 2) + 0.0 for end in ("value", "low", "high"))
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


if __name__ == "__main__":
    main()
