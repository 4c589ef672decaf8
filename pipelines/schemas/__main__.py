"""``python -m pipelines.schemas``: write the JSON schemas of `results_schema`."""

from __future__ import annotations

from pipelines.schemas import write

if __name__ == "__main__":
    for file in write():
        print(file)
