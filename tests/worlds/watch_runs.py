"""How often `gap watch` alarms over healthy drives of the project's own processes, and how soon after an effect was switched on.

A log is one run over generated scenarios, no two alike (`town`: all families, policy expert, which brakes and turns; `steady`: the
same, policy lattice, which hardly does; `ground`: a proving ground, the recorded drive followed). The first logs make the baseline, the others are watched one after another. With `--effects`, each is
switched on after a healthy log: delays count from the first drive with it. With `--live`, scenarios are driven by a fleet of
six processes and watched on the bus while they go on.

    python tests/worlds/watch_runs.py --out DIR --seed SEED --driving town --watched 40 --rates 1 10 --effects gyro_bias=0.01
    python tests/worlds/watch_runs.py --out DIR --seed SEED --driving town --live 40
"""

import argparse
import json
import math
import pathlib
import shutil
import socket
import subprocess
import time

import proving_ground
from watch_rates import poisson

POLICY = {"town": "expert", "steady": "lattice", "ground": "log-replay"}


class World:
    """Scenarios and drives below a folder, all from one seed."""

    def __init__(self, given):
        self.given, self.seeds = given, iter(range(given.seed * 1000, given.seed * 1000 + 1000))

    def call(self, *arguments):
        command = [self.given.program, *map(str, arguments)]
        said = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if said.returncode:
            raise SystemExit(f"{' '.join(command)}\n{said.stderr}")

    def scenarios(self, count):
        """Returns a folder of scenarios that nobody else has, and its seed."""
        seed = next(self.seeds)
        folder = self.given.out / f"{self.given.driving}-{seed}"
        if not folder.exists():
            if self.given.driving == "ground":
                proving_ground.write(folder, seed, count, self.given.secs)
            else:
                self.call("scenario", "generate", "--seed", seed * 100, "--count", count, "-o", folder)
        return folder, seed

    def words(self, folder, seed):
        return [folder, "--policy", POLICY[self.given.driving], "--observation", "layout", "--duration", 0, "--vehicle-log", "--seed", seed]

    def log(self, effect=None):
        """Drives one log and returns the folder of its vehicle logs."""
        folder, seed = self.scenarios(self.given.drives)
        out = self.given.out / f"{folder.name}-{effect or 'healthy'}"
        if not (out / "real/meta.json").exists():
            switched = ["--effect", effect] if effect else []
            self.call("run", *self.words(folder, seed), *switched, "--no-pictures", "--overwrite", "--out", out)
            shutil.rmtree(out / "recordings", ignore_errors=True)
        return out / "real"

    def watched(self, logs, baseline, rate):
        out = self.given.out / "watched.json"
        self.call("gap", "watch", *logs, "--baseline", baseline, "--alarms-per-hour", rate, "--alarms-only", "-o", out)
        return json.loads(out.read_text())


def told(name, alarms, hours, rate):
    low, high = (count / hours / rate for count in poisson(alarms))
    print(f"{name}: {alarms} alarms in {hours:.2f} h, {rate:g} an hour set = {alarms / hours / rate:.2f} times [{low:.2f}, {high:.2f}]", flush=True)


def delay(report, since_hours):
    """Seconds that were watched from some time on to the first alarm; without a limit where there is none."""
    return min((3600 * (alarm["hours"] - since_hours) for alarm in report["alarms"] if alarm["hours"] > since_hours), default=math.inf)


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def live(world, baseline, rate):
    """Drives scenarios by a fleet of processes, one after another, watched on the bus."""
    given, folder = world.given, world.given.out / "live"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    bus, control = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    started = []

    def start(log, *arguments):
        file = open(folder / f"{log}.log", "w")
        started.append(subprocess.Popen([given.program, *map(str, arguments)], stdout=file, stderr=file, stdin=subprocess.DEVNULL))
        return started[-1]

    def serve(service, *settings):
        start(service, "serve", service, *(word for setting in settings for word in ("--set", setting)))

    try:
        serve("router", 'bus.mode="router"', "bus.connect=[]", f'bus.listen=["{bus}"]')
        time.sleep(2)
        reach = [f'bus.connect=["{bus}"]']
        serve("orchestrator", *reach, f'journal.folder="{folder / "runs"}"', f'control.listen="{control}"')
        time.sleep(2)
        for service in ["sim-server", "layout-render", "policy-bridge", "vdm-worker"]:
            serve(service, *reach, f'control.orchestrator="http://{control}"')
        scenarios, seed = world.scenarios(given.live)
        watch = start("watch", "gap", "watch", "--bus", bus, "--orchestrator", f"http://{control}", "--baseline", baseline, "--alarms-per-hour", rate, "--drives", given.live)
        time.sleep(2)
        for scenario in sorted(scenarios.iterdir()):
            words = world.words(scenario, seed)
            world.call("submit", "--orchestrator", f"http://{control}", "--out", folder / "out" / scenario.name, *words)
            time.sleep(0.5)
        try:
            watch.wait(60)
        except subprocess.TimeoutExpired:
            print("the watch missed drives")
        said = (folder / "watch.log").read_text().splitlines()
        print("\n".join(line for line in said if "watching" not in line), flush=True)
    finally:
        for child in reversed(started):
            child.kill()
            child.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--driving", choices=POLICY, default="town")
    parser.add_argument("--drives", type=int, default=10, help="scenarios of a log")
    parser.add_argument("--secs", type=float, default=30.0, help="length of a drive on the proving ground")
    parser.add_argument("--logs", type=int, default=3, help="healthy logs of the baseline")
    parser.add_argument("--watched", type=int, default=20, help="healthy logs that are watched")
    parser.add_argument("--rates", type=float, nargs="*", default=[1.0, 10.0])
    parser.add_argument("--effects", nargs="*", default=[], help="ID=VALUE, each switched on after a healthy log")
    parser.add_argument("--live", type=int, default=0, help="scenarios that are watched while a fleet drives them")
    parser.add_argument("--program", default="target/debug/dreamstream")
    given = parser.parse_args()
    given.out = given.out.absolute()
    given.out.mkdir(parents=True, exist_ok=True)
    world = World(given)
    baseline = given.out / f"baseline-{given.driving}-{given.seed}.json"
    healthy = [world.log() for _ in range(given.logs)]
    if not baseline.exists():
        world.call("gap", "baseline", *healthy, "-o", baseline)
    logs = [world.log() for _ in range(given.watched)]
    for rate in given.rates if logs else []:
        report = world.watched(logs, baseline, rate)
        told(f"{given.driving}, recorded", len(report["alarms"]), report["hours"], rate)
        for alarm in report["alarms"]:
            print("  ", alarm["case"], alarm["file"], f"{alarm['secs']:.1f} s", ", ".join(f"{name} {share:.2f}" for name, share in alarm["channels"]))
    for effect in given.effects:
        before = world.log()
        since = world.watched([before], baseline, given.rates[0])["hours"]
        report = world.watched([before, world.log(effect)], baseline, given.rates[0])
        print(f"{effect}: first alarm after {delay(report, since):.0f} s", flush=True)
    if given.live:
        live(world, baseline, given.rates[0])


if __name__ == "__main__":
    main()
