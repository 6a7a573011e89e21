"""Probability of detection against effect size for the ten commonest effects, on the own reference world.

Draws the cases, runs the diagnosis on them and writes a table and a figure. Needs numpy and the `dynamics-practice` command.

    python tests/worlds/detection_curve.py --work DIR --seed 9001 --practice target/release/examples/dynamics-practice --figure docs/measurements/detection.svg
"""

import argparse
import json
import pathlib
import subprocess
import sys

import own_world

COLOURS = ["#1b6ca8", "#c8553d", "#2f9e6e", "#8a5fbf", "#b8860b", "#d1498b", "#3a3a3a", "#17a2a2", "#7a8b00", "#a0522d"]


def outcomes(work):
    """Returns (effect, size step, found) per case; found means that the accepted effects contain it or its group does."""
    labels = json.loads((work / "world" / "labels.json").read_text())
    rows = []
    for name in sorted(labels):
        number = int(name.rsplit("_", 1)[1])
        step = number // len(own_world.COMMON) % own_world.CURVE_STEPS
        effect = labels[name]["effects"][0]["id"]
        diagnosis = json.loads((work / "diagnoses" / name / "diagnosis.json").read_text())
        accepted = [e for e in diagnosis["effects"] if e["id"] in diagnosis["chosen"]]
        rows.append((effect, step, any(effect == e["id"] or effect in e["group"] for e in accepted)))
    return rows


def size_of(effect, step):
    """Returns the drawn magnitude of a step, as in the world's table of effects."""
    _, _, weak, strong, _ = own_world.EFFECTS[effect]
    return weak / 4 * (strong / weak * 4) ** (step / (own_world.CURVE_STEPS - 1))


def shares(rows):
    """Returns the share found per effect and step."""
    found = {e: [[] for _ in range(own_world.CURVE_STEPS)] for e in own_world.COMMON}
    for effect, step, hit in rows:
        found[effect][step].append(hit)
    return {e: [sum(hits) / max(len(hits), 1) for hits in steps] for e, steps in found.items()}


def table(found):
    """Returns the table in Markdown: magnitude and share found per step."""
    head = "| effect | " + " | ".join(f"step {k + 1}" for k in range(own_world.CURVE_STEPS)) + " |"
    lines = [head, "|" + "---|" * (own_world.CURVE_STEPS + 1)]
    for effect, steps in found.items():
        unit = own_world.EFFECTS[effect][0]
        cells = [f"{size_of(effect, k):.2g}: {share:.2f}" for k, share in enumerate(steps)]
        lines.append(f"| {effect} ({unit}) | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def figure(found):
    """Returns the curves as SVG: share found against the step from a quarter of the weakest to the strongest."""
    wide, high, left, top = 640, 360, 60, 20
    x = lambda k: left + k * (wide / (own_world.CURVE_STEPS - 1))
    y = lambda share: top + (1 - share) * high
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide + 260}" height="{high + 80}" font-family="sans-serif" font-size="12">',
           '<rect width="100%" height="100%" fill="white"/>']
    for share in (0, 0.25, 0.5, 0.75, 1):
        out.append(f'<line x1="{left}" x2="{left + wide}" y1="{y(share)}" y2="{y(share)}" stroke="#ddd"/>')
        out.append(f'<text x="{left - 8}" y="{y(share) + 4}" text-anchor="end">{share:g}</text>')
    for k in range(own_world.CURVE_STEPS):
        out.append(f'<text x="{x(k)}" y="{top + high + 18}" text-anchor="middle">{k + 1}</text>')
    out.append(f'<text x="{left + wide / 2}" y="{top + high + 42}" text-anchor="middle">size, step from a quarter of the weakest to the strongest (logarithmic)</text>')
    out.append(f'<text transform="translate(16,{top + high / 2}) rotate(-90)" text-anchor="middle">share detected</text>')
    for (effect, steps), colour in zip(found.items(), COLOURS):
        points = " ".join(f"{x(k):.1f},{y(share):.1f}" for k, share in enumerate(steps))
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
    for k, ((effect, _), colour) in enumerate(zip(found.items(), COLOURS)):
        low, top_size = size_of(effect, 0), size_of(effect, own_world.CURVE_STEPS - 1)
        out.append(f'<line x1="{left + wide + 12}" x2="{left + wide + 32}" y1="{top + 12 + 20 * k}" y2="{top + 12 + 20 * k}" stroke="{colour}" stroke-width="3"/>')
        out.append(f'<text x="{left + wide + 38}" y="{top + 16 + 20 * k}">{effect}, {low:.2g} to {top_size:.2g} {own_world.EFFECTS[effect][0]}</text>')
    return "\n".join(out + ["</svg>"]) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=9001)
    parser.add_argument("--draws", type=int, default=2, help="cases per effect and size")
    parser.add_argument("--practice", default="target/release/examples/dynamics-practice")
    parser.add_argument("--figure", type=pathlib.Path, required=True)
    given = parser.parse_args()
    world, found = given.work / "world", given.work / "diagnoses"
    here = pathlib.Path(__file__).parent
    subprocess.run([sys.executable, here / "own_world.py", "--out", world, "--seed", str(given.seed), "--curve", str(given.draws)], check=True)
    subprocess.run([given.practice, world, "--out", found, "--quick"], check=True, stdout=subprocess.DEVNULL)
    result = shares(outcomes(given.work))
    given.figure.write_text(figure(result))
    print(table(result))


if __name__ == "__main__":
    main()
