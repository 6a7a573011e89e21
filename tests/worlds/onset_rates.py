"""How well a diagnosis dates effects: labels of a reference world against the diagnoses of its cases.

Prints how often the effect was accepted, how often it was dated within three seconds in the right drive, how often the 90 %
set holds the truth, and how often an effect that acts all the time is said to begin, end or grow. A case without a
diagnosis counts as missed.

    python tests/worlds/own_world.py --out WORLD --seed 5101 --onset 44
    dreamstream gap diagnose WORLD --quick --no-pages -o OUT
    python tests/worlds/onset_rates.py WORLD OUT
"""

import argparse
import json
import pathlib

from baseline_rates import wilson

WITHIN_SECS = 3.0


def judge(label, diagnosis):
    """Judges one case: what is counted, and whether it holds; absent where it does not apply."""
    course = (diagnosis or {}).get("modulation") or {}
    onset = label.get("onset")
    if onset is None:
        return {"constant effect called changing": course.get("kind", "constant") != "constant"} if label["effects"] else {}
    accepted = bool(diagnosis) and bool(diagnosis["chosen"])
    right = accepted and diagnosis["chosen"] == [e["id"] for e in label["effects"]]
    here = course.get("drive") == onset["drive"] and "onset_s" in course
    near = here and abs(course["onset_s"] - onset["secs"]) <= WITHIN_SECS
    out = {"an effect accepted": accepted, "the right one alone": right, f"dated within {WITHIN_SECS:.0f} s": near}
    if accepted:
        out["the same, of those accepted"] = near
        low, high = course.get("interval90", [0.0, 0.0])
        out["90 % set holds, of those accepted"] = here and low <= onset["secs"] <= high
    if right:
        out["dated, of the right ones"] = near
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--each", action="store_true", help="also a line for each case")
    given = parser.parse_args()
    counts = {}
    for name, label in json.loads((given.world / "labels.json").read_text()).items():
        path = given.out / name / "diagnosis.json"
        diagnosis = json.loads(path.read_text()) if path.exists() else None
        judged = judge(label, diagnosis)
        for what, holds in judged.items():
            hits, of = counts.get(what, (0, 0))
            counts[what] = (hits + bool(holds), of + 1)
        if given.each and diagnosis:
            course = diagnosis.get("modulation") or {}
            told = {k: course[k] for k in ("effect", "kind", "drive", "scope", "onset_s", "interval90", "evidence") if k in course}
            print(name, [e["id"] for e in label["effects"]], label.get("onset"), "→", diagnosis["verdict"], diagnosis["chosen"], told)
    for what, (hits, of) in counts.items():
        print(f"{what:36} {wilson(hits, of)}")


if __name__ == "__main__":
    main()
