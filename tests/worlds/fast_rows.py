"""Makes ten rows of each row of a folder of cases: 20 Hz logs as logs of 200 rows a second.

Between two rows commands and measurements go by straight lines, or with `--held` measurements stay until the next.

    python tests/worlds/fast_rows.py CASES --out OUT [--held]
    dreamstream gap diagnose CASES --quick --out SLOW && dreamstream gap diagnose OUT --quick --out FAST
"""

import argparse
import csv
import pathlib
import shutil

ROWS, MOVING = 10, ("t", "cmd_steer", "cmd_accel")


def between(before, after, u, held):
    """Returns the cells of a row at a share of the way from one to the next."""
    def cell(name):
        if not before[name] or not after[name] or (held and name not in MOVING):
            return before[name]
        a, b = float(before[name]), float(after[name])
        return f"{a + u * (b - a):.6f}"
    return [cell(name) for name in before]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--held", action="store_true")
    given = parser.parse_args()
    shutil.copytree(given.cases, given.out)
    for path in given.out.glob("*/drive_*.csv"):
        with open(path) as file:
            rows = list(csv.DictReader(file))
        fast = [between(a, b, k / ROWS, given.held) for a, b in zip(rows, rows[1:]) for k in range(ROWS)]
        with open(path, "w", newline="") as file:
            csv.writer(file).writerows([list(rows[0]), *fast])


if __name__ == "__main__":
    main()
