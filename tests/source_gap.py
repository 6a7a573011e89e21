"""How far driving scores on other frames lie from those on reference frames, scenario by scenario.

python3 tests/source_gap.py BENCHMARK...      folders of `benchmark run`, one of which drove on `reference`
"""
import json
import random
import sys
from collections import defaultdict
from pathlib import Path

DRAWS = 5_000


def interval(values: list[float], draw: random.Random) -> str:
    means = sorted(sum(draw.choices(values, k=len(values))) / len(values) for _ in range(DRAWS))
    return f"{sum(values) / len(values):.1f} [{means[DRAWS // 40]:.1f}, {means[-DRAWS // 40]:.1f}]"


def main(folders: list[str]) -> None:
    scores = defaultdict(dict)
    for folder in folders:
        for line in Path(folder, "cells.jsonl").read_text().splitlines():
            cell = json.loads(line)
            arm = (cell["cell"]["policy"]["name"], cell["cell"]["observation"]["name"])
            scores[arm][cell["cell"]["scenario"], cell["cell"]["seed"]] = 100 * cell["episode"]["driving_score"]
    draw = random.Random(1)
    for (policy, source), driven in sorted(scores.items()):
        reference = scores.get((policy, "reference"), {})
        apart = [driven[key] - reference[key] for key in sorted(driven) if key in reference]
        if source == "reference" or not apart:
            continue
        far, mean = interval([abs(value) for value in apart], draw), interval(apart, draw)
        print(f"{policy:<12} {source:<12} {len(apart):>4} drives   mean |DS - reference| {far}   mean difference {mean}")


if __name__ == "__main__":
    main(sys.argv[1:])
